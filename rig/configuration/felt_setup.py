"""Table ``[felt]`` of the rig file: how the arm presses a felt, what gives way between them, and what is allowed."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from rig.configuration.channels import Number, Table


class FeltConfig(Table):
    """The arm as a press for felts (``pianorig record --felt``).

    The scale of ``encoder`` is mounted on the motor's shaft for this. ``compliance_m_per_n`` is that of arm and load
    cell between shaft and felt; ``record --felt block`` measures it. Beyond ``force_limit_n`` or ``depth_limit_m`` the
    press ends at once.
    """

    encoder: Literal["key", "whippen", "hammer"] = "key"
    radius_m: Number = Field(gt=0, le=1)
    """From the shaft to where the felt is touched."""
    u_radius_m: Number = Field(default=1e-4, ge=0, le=0.01)
    compliance_m_per_n: Number = Field(ge=0, le=1e-3)
    u_compliance_m_per_n: Number = Field(ge=0, le=1e-3)
    force_limit_n: Number = Field(default=50.0, gt=0, le=120)
    depth_limit_m: Number = Field(default=3e-3, gt=0, le=0.02)
