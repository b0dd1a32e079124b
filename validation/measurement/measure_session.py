"""Usable trials of a session, and the reason for each that is not: the first stage of a comparison.

Rejected, damaged and incomplete trials are named and left out; the rest goes on.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from rig.errors import RigError
from rig.session import Session, Trial, TrialData
from validation.conventions import Array
from validation.errors import TrialError, ValidationInputError
from validation.measurement.geometry import ActionGeometry
from validation.measurement.position_sensors import SPEED_OVER_S, SensorCalibration
from validation.measurement.positions import AS_FAR_AS_SEEN, measure_positions
from validation.measurement.trial import MeasuredTrial, measure

USABLE_STATUS = ("complete", "not at rest")
REJECTED, OTHER_CONDITION, NOT_PREDICTED = "rejected:", "recorded under the condition", "not predicted:"
"""How the reason begins where a trial is not used though nothing is known against its data."""
BY_RULER = SensorCalibration()


@dataclass(frozen=True)
class MeasuredSession:
    """Usable trials of a session, and by number the reason for each that is not."""

    session: Session
    trials: tuple[MeasuredTrial, ...]
    refused: dict[int, str]


def open_session(session: Session | str | Path) -> Session:
    opened = Session.open(session) if isinstance(session, str | Path) else session
    if opened.info.kind == "felt":
        raise ValidationInputError(
            f"{opened.path}: presses of a felt, not blows on a key; calibrate felt reads its derived/felt/"
        )
    return opened


IMPORTED = "import"
"""Backend of a session without a trial plan, whose trials may be of several conditions all the same."""


def conditions_of(session: Session) -> list[str]:
    """Conditions of a session's trial plan; of an imported session, which has none, those of its trials."""
    planned = [c.name for c in session.info.plan.conditions]
    if planned or session.info.backend.get("name") != IMPORTED:
        return planned
    return list(dict.fromkeys(t.condition for t in session.trials if t.rejected is None))


def list_usable_trials(
    session: Session, read: Callable[[Trial, TrialData], MeasuredTrial], only: int | None = None
) -> tuple[list[MeasuredTrial], dict[int, str]]:
    """Trials for which ``read`` succeeds (of all, or the one numbered ``only``), and by number why each other one is
    not used (rejected, unreadable, refused by ``read``); warns of files that cannot be read."""
    found, refused = [], {}
    for trial in session.trials if only is None else (session.trial(only),):
        if trial.rejected is not None:
            refused[trial.number] = f"{REJECTED} {trial.rejected}"
            continue
        try:
            found.append(read(trial, trial.read()))
        except (RigError, TrialError) as error:
            trial.warn_if_unreadable()
            refused[trial.number] = str(error)
    return found, refused


def measure_session(
    session: Session,
    geometry: Callable[[float], ActionGeometry],
    u_rest_level_m: float,
    condition: str | None = None,
    by_motion: bool = False,
    calibration: SensorCalibration = BY_RULER,
    only: int | None = None,
) -> MeasuredSession:
    """Usable trials measured with the action's ``geometry`` at the preload, N, and by number why others are not used;
    ``u_rest_level_m``: u of heights at rest, ``by_motion``: the key drives. Raises an input error where conditions
    differ, none chosen.

    Parameters
    ----------
    geometry : returns the geometry of the action under test at a preload, N
    u_rest_level_m : standard uncertainty of hammer height and key dip at rest on the bench
    condition : the only condition of the trial plan to use
    by_motion : the measured key drives the model in all trials, not only where no force was recorded
    calibration : errors of position sensors, of the action under test
    only : number of the one trial to measure
    """
    conditions: dict[int, str] = {}

    def read(trial: Trial, data: TrialData) -> MeasuredTrial:
        of_positions = not data.has_force and bool(data.position_names)
        allowed = AS_FAR_AS_SEEN if of_positions else USABLE_STATUS
        if data.status not in allowed:
            raise TrialError(f"recorded with status {data.status!r}: {data.reason or 'no reason given'}")
        if not data.has_force and not of_positions and data.absent:
            raise TrialError(
                f"neither force nor measured key motion to drive the model: no encoder of {', '.join(data.absent)}"
            )
        conditions[trial.number] = data.condition
        if condition is not None and data.condition != condition:
            raise TrialError(f"{OTHER_CONDITION} {data.condition!r}, not {condition!r}")
        if of_positions:
            return measure_positions(data, calibration, trial.sha256)
        derived = session.read_derived("angles", trial.number)
        film = None if derived is None else derived[0]
        action_geometry = geometry(data.force_info.preload_n)
        return measure(
            data, film, action_geometry, u_rest_level_m=u_rest_level_m, seal=trial.sha256, by_motion=by_motion
        )

    every, refused = list_usable_trials(session, read, only)
    measured: list[MeasuredTrial] = []
    for one in every:
        measured.append(_share_times(one, measured[-1]) if measured else one)
    usable = Counter(name for number, name in conditions.items() if condition is not None or number not in refused)
    found = ", ".join(f"{name!r} ({n} trials)" for name, n in sorted(usable.items()))
    if condition is None and len(usable) > 1:
        raise ValidationInputError(
            f"{session.path}: trials of several conditions found: {found}; allowed one, for different motions have no "
            "common repeatability; choose it with `condition`"
        )
    if condition is not None and usable and condition not in usable:
        raise ValidationInputError(f"{session.path}: no usable trial of the condition {condition!r}; found {found}")
    return MeasuredSession(session, tuple(measured), refused)


def _share_times(m: MeasuredTrial, other: MeasuredTrial) -> MeasuredTrial:
    """Copy of a trial that holds the time arrays of ``other`` where they are equal, which saves memory."""

    def pick_shared(mine: Array, theirs: Array) -> Array:
        return theirs if np.array_equal(mine, theirs) else mine

    time = pick_shared(m.time_s, other.time_s)
    force = replace(m.force, time_s=pick_shared(m.force.time_s, other.force.time_s))
    return replace(m, time_s=time, force=force)


def select_representative(trials: tuple[MeasuredTrial, ...] | list[MeasuredTrial]) -> MeasuredTrial:
    """The trial of median peak force (of an even number the lower middle one), which stands for all where many runs of
    the model are needed; of median key speed where a trial has no force. ``trials``: one at least."""
    by_force = all(m.has_force for m in trials)
    order = sorted(
        trials, key=lambda m: (float(m.force.force_n.max()) if by_force else _largest_key_turn_rad(m), m.number)
    )
    return order[(len(order) - 1) // 2]


def _largest_key_turn_rad(m: MeasuredTrial) -> float:
    """Largest change of the key's angle within `SPEED_OVER_S`, rad."""
    key, reach = m.change_rad[:, 0], max(round(SPEED_OVER_S / float(np.median(np.diff(m.time_s)))), 1)
    return float(np.abs(key[reach:] - key[:-reach]).max()) if key.size > reach else 0.0
