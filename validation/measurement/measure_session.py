"""Usable trials of a session, and the reason for each that is not: the first stage of a comparison.

Rejected, damaged and incomplete trials are named and left out; the rest goes on.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

import numpy as np

from rig.errors import RigError
from rig.session import Session, Trial, TrialData
from validation.conventions import Array
from validation.errors import TrialError, ValidationInputError
from validation.measurement.geometry import ActionGeometry
from validation.measurement.trial import MeasuredTrial, measure

T = TypeVar("T")
USABLE_STATUS = ("complete", "not at rest")
REJECTED, OTHER_CONDITION, NOT_PREDICTED = "rejected:", "recorded under the condition", "not predicted:"
"""How the reason begins where a trial is not used though nothing is known against its data."""


@dataclass(frozen=True)
class MeasuredSession:
    """Usable trials of a session, and by number the reason for each that is not."""

    session: Session
    trials: tuple[MeasuredTrial, ...]
    refused: dict[int, str]


def open_session(session: Session | str | Path) -> Session:
    """The session itself, or the session at a path.

    Raises
    ------
    ValidationInputError
        The arm pressed a felt in it: there is no key to compare.
    """
    opened = Session.open(session) if isinstance(session, str | Path) else session
    if opened.info.kind == "felt":
        raise ValidationInputError(
            f"{opened.path}: presses of a felt, not blows on a key; calibrate felt reads its derived/felt/"
        )
    return opened


def usable_trials(
    session: Session, read: Callable[[Trial, TrialData], T], statuses: Sequence[str] = ("complete",)
) -> tuple[list[T], dict[int, str]]:
    """What is read of every usable trial, with force or positions, and by number the reason for every other.

    Parameters
    ----------
    read : given a trial and its data; raises `TrialError` where it cannot be used
    statuses : of a recording that can be used
    """
    found, refused = [], {}
    for trial in session.trials:
        if trial.rejected is not None:
            refused[trial.number] = f"{REJECTED} {trial.rejected}"
            continue
        try:
            data = trial.read()
            if data.status not in statuses:
                raise TrialError(f"recorded with status {data.status!r}: {data.reason or 'no reason given'}")
            found.append(read(trial, data))
        except (RigError, TrialError) as error:
            trial.warn_if_unreadable()
            refused[trial.number] = str(error)
    return found, refused


def measure_session(
    session: Session,
    geometry: Callable[[float], ActionGeometry],
    u_rest_level_m: float,
    condition: str | None = None,
    without_force: bool = False,
) -> MeasuredSession:
    """Measure every usable trial.

    Parameters
    ----------
    geometry : geometry of the action under test at a preload in N
    u_rest_level_m : standard uncertainty of hammer height and key dip at rest on the bench
    condition : the only condition of the trial plan to use
    without_force : also trials that have encoder angles alone

    Raises
    ------
    ValidationInputError
        The usable trials are of several conditions and none was chosen, or the chosen one was not recorded.
    """
    conditions: dict[int, str] = {}

    def read(trial: Trial, data: TrialData) -> MeasuredTrial:
        if not data.has_force and not without_force:
            raise TrialError("no force was recorded; a session of positions is compared by motion (--by-motion)")
        if not data.has_force and data.absent:
            raise TrialError(
                "neither force nor measured key motion to drive the model: no encoder of "
                f"{', '.join(data.absent)}; a session of positions is compared by motion (validate --by-motion)"
            )
        conditions[trial.number] = data.condition
        if condition is not None and data.condition != condition:
            raise TrialError(f"{OTHER_CONDITION} {data.condition!r}, not {condition!r}")
        derived = session.read_derived("angles", trial.number)
        film = None if derived is None else derived[0]
        action_geometry = geometry(data.force_info.preload_n)
        return measure(data, film, action_geometry, u_rest_level_m=u_rest_level_m, seal=trial.sha256)

    every, refused = usable_trials(session, read, USABLE_STATUS)
    measured: list[MeasuredTrial] = []
    for one in every:
        measured.append(_sharing_times(one, measured[-1]) if measured else one)
    usable = Counter(name for number, name in conditions.items() if condition is not None or number not in refused)
    found = ", ".join(f"{name!r} ({n} trials)" for name, n in sorted(usable.items()))
    if condition is None and len(usable) > 1:
        raise ValidationInputError(
            f"{session.path}: trials of several conditions found: {found}; allowed one, for different motions have no "
            "common repeatability; choose it with --condition"
        )
    if condition is not None and usable and condition not in usable:
        raise ValidationInputError(f"{session.path}: no usable trial of the condition {condition!r}; found {found}")
    return MeasuredSession(session, tuple(measured), refused)


def _sharing_times(m: MeasuredTrial, other: MeasuredTrial) -> MeasuredTrial:
    """The same trial with the other's arrays of times where they are equal."""

    def shared(mine: Array, theirs: Array) -> Array:
        return theirs if np.array_equal(mine, theirs) else mine

    time = shared(m.time_s, other.time_s)
    force = replace(m.force, time_s=shared(m.force.time_s, other.force.time_s))
    return replace(m, time_s=time, force=force)


def representative(trials: tuple[MeasuredTrial, ...] | list[MeasuredTrial]) -> MeasuredTrial:
    """The trial of median peak force, which stands for all where many runs of the model are needed."""
    order = sorted(trials, key=lambda m: (float(m.force.force_n.max()), m.number))
    return order[(len(order) - 1) // 2]
