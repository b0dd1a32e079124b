"""Strokes that could be recorded next: each shipped profile at several levels of force, and each session once more.

What the bench's limits forbid is left out, with the reason. The blow is predicted by the identified action on the arm
of the rig file (a callable, as for the rig's dry run), and read as the bench's sensors would read it, without noise.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rig import PredictedBlow, Profile, RigConfig, RigError, dry_run, load_profile, motor_command, parse_profile
from rig.configuration.profile import built_in_profiles
from validation.errors import ValidationInputError
from validation.identification.observations import ObservedTrial, observe
from validation.measurement.force_correction import Quiet
from validation.measurement.trial import MeasuredTrial

LEVELS = (0.7, 1.0, 1.4)
REST_S = 0.1  # of rest before the blow
STARTS = 0.01  # of the largest change of the force


@dataclass(frozen=True)
class Candidate:
    """A stroke that could be recorded.

    Attributes
    ----------
    name : what it is, in words
    trial : as it would be observed
    profile : what the motor would play; None for more of a session's own
    """

    name: str
    trial: ObservedTrial
    profile: Profile | None = None


def shelf(
    config: RigConfig,
    predict: Callable[[Profile], PredictedBlow],
    like: MeasuredTrial,
    phases: int,
    levels: Sequence[float] = LEVELS,
) -> tuple[list[Candidate], list[str]]:
    """Every shipped profile at every level that the bench allows.

    Parameters
    ----------
    config : RigConfig
    predict : callable
        The blow that a profile gives.
    like : MeasuredTrial
        A trial of the bench; sensors and preload are taken from it.
    phases : how many times of a trial are compared
    levels : factors of the force

    Returns
    -------
    candidates, refused : lists
        The second says why a profile is not among the first.
    """
    found: list[Candidate] = []
    refused: list[str] = []
    for name in built_in_profiles():
        for level in levels:
            profile = at_level(load_profile(name), level)
            kept: list[PredictedBlow] = []

            def remember(one: Profile, kept: list[PredictedBlow] = kept) -> PredictedBlow:
                kept.append(predict(one))
                return kept[0]

            try:
                motor_command(profile, config)
                dry_run(profile, config, remember)
                (trial,) = observe(profile.name, 0, [as_measured(kept[0], like)], phases)
            except (RigError, ValidationInputError) as error:
                refused.append(f"{profile.name}: {error}")
                continue
            found.append(Candidate(profile.name, trial, profile))
    return found, refused


def at_level(profile: Profile, level: float) -> Profile:
    """The profile with its force multiplied; itself at level 1."""
    if level == 1.0:
        return profile
    points = ", ".join(
        f"{{ time_s = {float(t)!r}, force_n = {float(level * f)!r} }}"
        for t, f in zip(profile.time_s, profile.force_n, strict=True)
    )
    name = f"{profile.name} x {level:g}"
    text = f'name = "{name}"\ninterpolation = "{profile.interpolation}"\npoints = [{points}]\n'
    return parse_profile(text, name)


def as_measured(blow: PredictedBlow, like: MeasuredTrial) -> MeasuredTrial:
    """The blow as the bench would measure it: sensors of another trial, no noise."""
    step = float(np.median(np.diff(blow.time_s)))
    rest = int(np.ceil(REST_S / step))
    time = np.concatenate([blow.time_s[0] + step * np.arange(-rest, 0), blow.time_s])
    force = np.concatenate([np.zeros(rest), blow.force_n - blow.force_n[0]]) + like.force.preload_n
    change = np.vstack([np.zeros((rest, blow.angle_rad.shape[1])), blow.angle_rad - blow.angle_rad[0]])
    away = np.abs(force - force[0])
    onset = int(np.argmax(away > STARTS * away.max()))
    return replace(
        like,
        number=0,
        time_s=time,
        raw_force_n=force,
        force=replace(like.force, time_s=time, force_n=force, u_force_n=np.zeros(time.size)),
        quiet=Quiet(onset, float(time[0]), float(time[onset]), float(time[onset])),
        change_rad=change,
        film=None,
        seal="",
    )
