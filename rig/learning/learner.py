"""The loop of learning: blow, compare, correct, until the measured force follows the target.

Place in the data flow: target → profile → ``blow`` (a callable that records one trial on the normal path, with
every interlock) → next profile. Each command is held inside the rig file's limits of force, slew rate, voltage and
heating before it is played. The profile that was played best is the result, in the key points that were played.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rig import toml_file
from rig.config import RigConfig
from rig.errors import InputError
from rig.learning.correction import Measured, corrected, measured_force, relative_rms, within_limits
from rig.learning.target import Target
from rig.profile import Profile, parse_profile
from rig.session.records import TrialData
from rig.trial_run import motor_command

GAIN = 0.8
GOAL = 0.03
MOST_BLOWS = 50
POINT_TOLERANCE = 0.002
"""Key points leave out what changes the command by less than this part of its peak."""


@dataclass(frozen=True, eq=False)
class Blow:
    """One blow of learning: what was played, what was felt, and its relative RMS error before key bottom."""

    number: int
    profile: Profile
    measured: Measured
    error: float


@dataclass(frozen=True, eq=False)
class Learned:
    """The blows in order; ``best`` is the one whose profile is the result."""

    target: Target
    blows: tuple[Blow, ...]
    best: Blow
    goal: float

    @property
    def follows(self) -> bool:
        """Whether the goal was reached."""
        return self.best.error <= self.goal


def learn(
    target: Target,
    config: RigConfig,
    blow: Callable[[Profile, int], TrialData],
    *,
    blows: int = 8,
    goal: float = GOAL,
    progress: Callable[[Blow], None] | None = None,
) -> Learned:
    """Learn the profile that makes the measured force follow a target.

    Parameters
    ----------
    target : Target
    config : RigConfig
        Its limits bound every command.
    blow : callable
        Plays a profile as blow number 1, 2, … and returns the recorded trial; its exceptions end the learning.
    blows : int
        Blows at most, 1 to 50.
    goal : float
        Relative RMS error before key bottom that is good enough.
    progress : callable, optional
        Called with each :class:`Blow`.

    Raises
    ------
    InputError
        Bad numbers, or a target outside the motor's limits.
    """
    if not 1 <= blows <= MOST_BLOWS:
        raise InputError(f"blows = {blows}, allowed 1 to {MOST_BLOWS}")
    if not 0 < goal < 1:
        raise InputError(f"goal = {goal:g}, allowed above 0 and below 1")
    motor, rate = config.motor, config.device.sample_rate_hz
    most_n = min(motor.force_limit_n, motor.voltage_limit_v * motor.force_per_volt_n)
    if target.peak_n > most_n:
        raise InputError(
            f"{target.name}: {target.peak_n:.4g} N before key bottom, allowed {most_n:g} N (motor of the rig file); "
            "give a smaller scale"
        )
    command, gain, done = target.command_n, GAIN, list[Blow]()
    for number in range(1, blows + 1):
        command = within_limits(command, most_n, motor.slew_limit_n_per_s, rate)
        profile = profile_of(target.name, command, rate, f"blow {number} of learning {target.name}")
        start_s = motor_command(profile, config).blow_start_s - profile.onset_s
        data = blow(profile, number)
        if data.status not in ("complete", "not at rest"):
            raise InputError(f"{target.name}: blow {number} ended as {data.status!r}; it cannot be learned from")
        measured = measured_force(data, target, start_s)
        done.append(Blow(number, profile, measured, relative_rms(target, measured)))
        if progress is not None:
            progress(done[-1])
        best = min(done, key=lambda entry: entry.error)
        if best.error <= goal:
            break
        if done[-1].error > 1.2 * best.error:  # it grew: back to the best one, in smaller steps
            gain *= 0.5
        played = np.zeros_like(target.time_s)
        sampled = best.profile.sample(rate)[: played.size]
        played[: sampled.size] = sampled
        command = corrected(played, target, best.measured, gain, rate)
    return Learned(target, tuple(done), best, goal)


def profile_of(name: str, command_n: NDArray[np.float64], rate_hz: float, description: str) -> Profile:
    """Return a profile whose key points, joined by lines, give a command on the sample clock."""
    kept = key_points(command_n, POINT_TOLERANCE * float(np.max(np.abs(command_n), initial=1e-9)))
    points = [{"time_s": round(float(k / rate_hz), 7), "force_n": round(float(command_n[k]), 4)} for k in kept]
    points[0]["force_n"] = points[-1]["force_n"] = 0.0
    head = toml_file.dump_toml({"name": name, "description": description, "interpolation": "linear"})
    rows = "".join(f"  {{ time_s = {p['time_s']!r}, force_n = {p['force_n']!r} }},\n" for p in points)
    return parse_profile(f"{head}points = [\n{rows}]\n", name)


def key_points(values: NDArray[np.float64], tolerance: float) -> list[int]:
    """Return the samples to keep so that lines between them stay within ``tolerance`` (Ramer 1972)."""
    kept, open_spans = {0, values.size - 1}, [(0, values.size - 1)]
    while open_spans:
        low, high = open_spans.pop()
        if high - low < 2:
            continue
        inner = np.arange(low + 1, high)
        away = np.abs(values[inner] - np.interp(inner, [low, high], values[[low, high]]))
        worst = int(np.argmax(away))
        if away[worst] > tolerance:
            middle = int(inner[worst])
            kept.add(middle)
            open_spans += [(low, middle), (middle, high)]
    return sorted(kept)
