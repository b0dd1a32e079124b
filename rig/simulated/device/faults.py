"""Faults to plant on the virtual bench, read from text: their kinds, and when each strikes.

They are written ``KIND@TRIAL/SECONDS``, ``KIND:BODY@TRIAL/SECONDS`` or ``KIND@CALL#NUMBER``, several with commas, in
the option ``fault`` of a ``sim://`` address; e.g. ``sim://?fault=stuck:hammer@2/0.4,reserved@TaskControl%231``.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from rig.errors import RigInputError
from rig.simulated.bench.plant_protocol import ENCODED_BODIES
from rig.simulated.status import Code

STATUS = {
    "overwrite": Code.SAMPLES_NO_LONGER_AVAILABLE,
    "timeout": Code.SAMPLES_NOT_YET_AVAILABLE,
    "underrun": Code.GEN_STOPPED_TO_PREVENT_REGEN_OF_OLD_SAMPLES,
    "reserved": Code.PAL_RESOURCE_RESERVED,
    "device-lost": Code.DEV_CANNOT_BE_ACCESSED,
}


LASTING = ("device-lost", "server-gone", "underrun")
CELL = ("bridge-open", "saturated", "silent")
SCALE = ("stuck", "miscount")
CAMERA = ("dropped",)
SENSORS = (*CELL, *SCALE, *CAMERA)
KINDS = (*STATUS, "server-gone", *SENSORS)
_FORM = re.compile(r"([a-z-]+)(?::([a-z]+))?@(?:(\d+)/(\d+(?:\.\d+)?)|([A-Za-z0-9]+)#(\d+))")


@dataclass(frozen=True)
class Fault:
    """One fault: from ``at_s`` of trial ``trial`` on, or from the ``number``-th call named ``call`` on."""

    kind: str
    body: str = ""
    trial: int = 0
    at_s: float = 0.0
    call: str = ""
    number: int = 0


def parse_faults(text: str) -> tuple[Fault, ...]:
    """Read the faults to plant from text: ``KIND@TRIAL/SECONDS`` or ``KIND@CALL#NUMBER``, ``KIND:BODY@…`` for those of
    an encoder, several with commas; refuse another form, kind or body."""
    faults = []
    for part in filter(None, text.split(",")):
        match = _FORM.fullmatch(part)
        kind, body, trial, at_s, call, number = match.groups("") if match else ("",) * _FORM.groups
        if match is None or kind not in KINDS or (kind in SCALE) != (body in ENCODED_BODIES):
            raise RigInputError(
                f"fault {part!r}: write KIND@TRIAL/SECONDS or KIND@CALL#NUMBER with a kind of {', '.join(KINDS)}, "
                f"and :BODY ({', '.join(ENCODED_BODIES)}) behind {' and '.join(SCALE)}"
            )
        faults.append(Fault(kind, body, int(trial or 0), float(at_s or 0), call, int(number or 0)))
    return tuple(faults)
