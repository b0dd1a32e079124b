"""Usable trials of a session, and the reason of each that is not.

Place in the data flow: `rig.session` → here (with `validation.measurement.trial`) →
`validation.pipeline.compare_session`.
Conventions: rejected, damaged and incomplete trials are named and kept out; the rest goes on.
Failure: a session that cannot be opened is an error of `rig.session`.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from validation.errors import InputError, TrialError
from validation.measurement.geometry import ActionGeometry
from validation.measurement.trial import Measurement, measure

USABLE_STATUS = ("complete", "not at rest")


def open_session(session: Any) -> Any:
    """The session itself, or the session at a path."""
    if not isinstance(session, str | Path):
        return session
    from rig.session import Session

    return Session.open(session)


def measure_all(
    session: Any, geometry: Callable[[float], ActionGeometry], u_rest_level_m: float, condition: str | None = None
) -> tuple[list[Measurement], dict[int, str]]:
    """Usable trials, and the reason of each that is not, by number.

    Parameters
    ----------
    session : rig.session.Session
    geometry : callable
        Geometry of the action under test at a preload in N.
    u_rest_level_m : float
        Standard uncertainty of hammer height and key dip at rest on the bench.
    condition : str, optional
        Condition of the trial plan to keep to.

    Raises
    ------
    InputError
        The usable trials are of several conditions and none was chosen, or the chosen one was not recorded.
    """
    from rig.errors import RigError

    measured, refused = [], {}
    conditions: dict[str, int] = {}
    for trial in session.trials:
        if trial.rejected is not None:
            refused[trial.number] = f"rejected: {trial.rejected}"
            continue
        try:
            data = trial.read()
            if data.status not in USABLE_STATUS:
                raise TrialError(f"recorded with status {data.status!r}: {data.reason or 'no reason given'}")
            conditions[data.condition] = conditions.get(data.condition, 0) + 1
            if condition is not None and data.condition != condition:
                refused[trial.number] = f"recorded under the condition {data.condition!r}, not {condition!r}"
                continue
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
    found = ", ".join(f"{name!r} ({n} trials)" for name, n in sorted(conditions.items()))
    if condition is None and len(conditions) > 1:
        raise InputError(
            f"{session.path}: trials of several conditions found: {found}; allowed one, for different motions have no "
            "common repeatability; choose it with --condition"
        )
    if condition is not None and conditions and condition not in conditions:
        raise InputError(f"{session.path}: no usable trial of the condition {condition!r}; found {found}")
    return measured, refused
