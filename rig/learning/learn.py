"""Learning of a profile that reproduces a recorded force: blow, compare, correct, until the measured force follows."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from rig.configuration.motor_command import motor_command
from rig.configuration.profile import Profile
from rig.configuration.rig_file import RigConfig
from rig.errors import RigInputError, refuse
from rig.learning.command import correct_command, limit_command, make_profile
from rig.learning.measured_force import LATE_S, Measured, late_share, measured_force, relative_rms
from rig.learning.target_force import TargetForce
from rig.session.trial_data import TrialData

GROWN = 1.2  # times the least error: choice; a blow of a larger one is taken to diverge
GAIN = 0.8  # of the error that one stroke corrects: below 1, so that noise is not learnt whole
GOAL = 0.03  # relative error of the force at which learning ends; needs a peak of 33 times the noise
MARGIN = 0.75  # of the goal, to which learning goes on while blows improve: a replay must follow as well
MOST_BLOWS = 50  # that a user may ask for


@dataclass(frozen=True, eq=False)
class Blow:
    """One blow of learning: what was played and measured, and its relative RMS error before key bottom.

    ``limited`` says that the motor's limits of force or slew rate cut the command before key bottom.
    """

    number: int
    profile: Profile
    measured: Measured
    error: float
    limited: bool = False


@dataclass(frozen=True, eq=False)
class Learned:
    """The blows in order; ``best`` is the one whose profile is the result."""

    target: TargetForce
    blows: tuple[Blow, ...]
    best: Blow
    goal: float

    @property
    def follows(self) -> bool:
        """Whether the goal was reached."""
        return self.best.error <= self.goal

    def obstacle(self) -> str:
        """Return in one clause what separates the best blow from the goal, as far as it is known."""
        if self.best.limited:
            return "the motor's limits of force or slew rate cut the command; give a smaller scale"
        share = late_share(self.target, self.best.measured)
        if share > 0.5:
            return (
                f"{100 * share:.0f} % of the squared error lies in the last {1e3 * LATE_S:g} ms before key bottom, "
                "where the action lets off faster than the arm follows"
            )
        return "more blows may help"


def learn(
    target: TargetForce,
    config: RigConfig,
    blow: Callable[[Profile, int], TrialData],
    *,
    blows: int = 8,  # choice: the virtual bench reaches the goal within five
    goal: float = GOAL,
    progress: Callable[[Blow], None] | None = None,
) -> Learned:
    """Learn the profile that makes the measured force follow ``target``: ``blow`` plays a profile as number 1, 2, … and
    returns its trial; end after ``blows``, or earlier where the relative RMS error before key bottom has met ``goal``.

    Parameters
    ----------
    target : TargetForce
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

    Returns
    -------
    Learned
        Every blow, and the best one with its profile.

    Raises
    ------
    RigInputError
        Bad numbers, or a target outside the motor's limits.

    Examples
    --------
    >>> import model
    >>> import rig
    >>> config = rig.load_rig("virtual").config
    >>> target = rig.make_target("forte", model.force_table("thesis-forte")[1], 2e-4, config.device.sample_rate_hz)
    >>> def blow(profile, number):
    ...     return rig.record(f"blows/{number}", profile=profile, trials=1).trial(1).read()
    >>> len(rig.learn(target, config, blow, blows=1).blows)
    1
    """
    refuse(
        RigInputError,
        (not 1 <= blows <= MOST_BLOWS, f"blows = {blows}, allowed 1 to {MOST_BLOWS}"),
        (not 0 < goal < 1, f"goal = {goal:g}, allowed above 0 and below 1"),
    )
    motor, rate = config.motor, config.device.sample_rate_hz
    most_n = min(motor.force_limit_n, motor.voltage_limit_v * motor.force_per_volt_n)
    _check_reachable(target, config, most_n)
    command, gain, played_blows = target.command_n, GAIN, list[Blow]()
    for number in range(1, blows + 1):
        unlimited = command
        command = limit_command(unlimited, most_n, motor.slew_limit_n_per_s, rate)
        limited = bool(np.any(np.abs(command - unlimited)[target.time_s <= target.bottom_s] > goal * target.peak_n))
        profile = make_profile(target.name, command, rate, f"blow {number} of learning {target.name}")
        start_s = motor_command(profile, config).blow_start_s - profile.onset_s
        data = blow(profile, number)
        if data.status not in ("complete", "not at rest"):
            raise RigInputError(f"{target.name}: blow {number} ended as {data.status!r}; it cannot be learned from")
        measured = measured_force(data, target, start_s)
        played_blows.append(Blow(number, profile, measured, relative_rms(target, measured), limited))
        if progress is not None:
            progress(played_blows[-1])
        best = min(played_blows, key=lambda entry: entry.error)
        if best.error <= MARGIN * goal or (best.error <= goal and best is not played_blows[-1]):
            break
        if played_blows[-1].error > GROWN * best.error:  # it grew: continue from the best one, in smaller steps
            gain *= 0.5
        played = np.zeros_like(target.time_s)
        sampled = best.profile.sample(rate)[: played.size]
        played[: sampled.size] = sampled
        command = correct_command(played, target, best.measured, gain, rate)
    return Learned(target, tuple(played_blows), best, goal)


def _check_reachable(target: TargetForce, config: RigConfig, most_n: float) -> None:
    """Refuse a target that no number of blows can reach on this rig: with a peak above ``most_n``, N, a rise above the
    motor's slew limit, or a peak so small that the load cell's noise hides the error."""
    peak_n, slew = target.peak_n, config.motor.slew_limit_n_per_s
    if peak_n > most_n:
        raise RigInputError(
            f"{target.name}: {peak_n:.4g} N before key bottom, allowed {most_n:g} N (motor of the rig file); give a "
            "smaller scale"
        )
    rise = float(np.diff(target.command_n[target.time_s <= target.bottom_s]).max(initial=0.0))
    rise *= config.device.sample_rate_hz
    if rise > slew:
        raise RigInputError(
            f"{target.name}: rises by {rise:.4g} N/s before key bottom, allowed {slew:g} N/s "
            "(motor.slew_limit_n_per_s of the rig file); give a smaller scale"
        )
    noise_n = config.force.u_noise_n
    if noise_n > GOAL * peak_n:
        raise RigInputError(
            f"{target.name}: {peak_n:.3g} N before key bottom, allowed from {noise_n / GOAL:.3g} N: the load cell's "
            f"noise of {noise_n:g} N hides the error; if the recording is not in N, give a scale"
        )
