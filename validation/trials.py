"""Usable trials of a session, and the reason of each that is not.

Place in the data flow: `rig.session` → here (with `validation.measurement`) → `validation.comparison`.
Conventions: rejected, damaged and incomplete trials are named and kept out; the rest goes on.
Failure: a session that cannot be opened is an error of `rig.session`.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from validation.errors import TrialError
from validation.geometry import ActionGeometry
from validation.measurement import Measurement, measure

USABLE_STATUS = ("complete", "not at rest")


def open_session(session: Any) -> Any:
    """The session itself, or the session at a path."""
    if not isinstance(session, str | Path):
        return session
    from rig.session import Session

    return Session.open(session)


def measure_all(
    session: Any, geometry: Callable[[float], ActionGeometry], u_rest_level_m: float
) -> tuple[list[Measurement], dict[int, str]]:
    """Usable trials, and the reason of each that is not, by number.

    Parameters
    ----------
    session : rig.session.Session
    geometry : callable
        Geometry of the action under test at a preload in N.
    u_rest_level_m : float
        Standard uncertainty of hammer height and key dip at rest on the bench.
    """
    from rig.errors import RigError

    measured, refused = [], {}
    for trial in session.trials:
        if trial.rejected is not None:
            refused[trial.number] = f"rejected: {trial.rejected}"
            continue
        try:
            data = trial.read()
            if data.status not in USABLE_STATUS:
                raise TrialError(f"recorded with status {data.status!r}: {data.reason or 'no reason given'}")
            derived = session.read_derived("angles", trial.number)
            measured.append(
                measure(
                    data,
                    None if derived is None else derived[0],
                    geometry(data.force_info.preload_n),
                    u_rest_level_m=u_rest_level_m,
                    seal=trial.sha256,
                )
            )
        except (RigError, TrialError) as error:
            refused[trial.number] = str(error)
    return measured, refused
