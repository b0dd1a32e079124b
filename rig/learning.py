"""Profiles that reproduce a recorded force: from a pianist's blow to a motor command, by iterative learning control.

Time zero of the target is `LEAD_S` before the force first rises; the resting force before that is subtracted; the force
ends at zero. Key bottom is the foot of the steepest rise (thesis Figs 3.6 to 3.8: the force rises gradually, then
spikes at key bottom), or is given. After it the command is the sustained force without the spike, since arm and finger
differ there.

Blow, compare, correct, until the measured force follows the target: a first-order law, u' = Q(u + gain · e). e is
target less measured force, taken where the command of the same instant is felt (the force channel's delay and the
sample from output to input are taken back); Q is a zero-phase low-pass, below the resonance of arm and load cell.
Nothing is learned after the earlier of the two key bottoms: the last correction fades there. Each command is brought
within the rig file's limits of force, slew rate, voltage and heating before it is played. Conventions: force in N,
positive downwards; arrays on the sample clock from the start of the profile. Law and convergence: Bristow, Tharayil &
Alleyne, IEEE Control Systems 26 (2006).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.signal import butter, sosfiltfilt

from rig.arrays import ArrayRecord, as_numbers
from rig.configuration import toml_file
from rig.configuration.profile import Profile, motor_command, parse_profile
from rig.configuration.rig_file import RigConfig
from rig.errors import RigInputError, refuse
from rig.mains_hum import fit_mains_hum
from rig.session.trial_data import TrialData

LEAD_S = 0.05  # before the force rises, as in the thesis's profiles
QUIET_S = 0.01  # rest that a recording must begin with: its mean and drift are the zero
LONGEST_INTERVAL_S = 0.005  # between samples of a recording: ten in the rise of a forte
LONGEST_S = 60.0  # of a recording: one blow was cut out
ONSET = 0.02  # of the peak before key bottom: the force has risen when it is so far off its rest
SMOOTH_S = 0.001  # window over which the force's slope is averaged
SPIKE = 4.0  # times the median slope of the rise before it: the spike at key bottom is as steep
FIRST = 0.3  # of the steepest slope: a check or a bounce later may be three times as steep
FOOT = 0.15  # of the way from the rise's slope to the spike's, where the spike begins: choice
SPIKE_S = 0.06  # after key bottom, taken for the spike and its ringing
RELEASE_S = 0.02  # in which the command goes to zero at the end
FADE_S = 0.01  # over which a command begins before the onset, and corrections end before key bottom
FIRST_CUTOFF_HZ = 60.0  # of the low-pass of the first command: a recording's ringing must not excite the arm
CUTOFF_HZ = 150.0  # of the low-pass Q: below the resonance of arm and cell
HIGHEST_CUTOFF = 0.4  # of the sample rate: a low-pass needs less than half of it


@dataclass(frozen=True, eq=False)
class TargetForce(ArrayRecord):
    """A force to reproduce.

    Attributes
    ----------
    name : str
    time_s, force_n : ndarray, shape (n,)
        On the sample clock, from `LEAD_S` before the onset, N.
    command_n : ndarray, shape (n,)
        First command: the same without the spike at key bottom, low-passed.
    onset_s, bottom_s : float
        When the force rises, when the key reaches bottom.
    rest_n : float
        Resting force that was subtracted, N (scaled).
    """

    name: str
    time_s: NDArray[np.float64]
    force_n: NDArray[np.float64]
    command_n: NDArray[np.float64]
    onset_s: float
    bottom_s: float
    rest_n: float

    @property
    def peak_n(self) -> float:
        """Largest force before key bottom, N."""
        return float(np.max(self.force_n[self.time_s <= self.bottom_s]))


def make_target(
    name: str,
    force_n: ArrayLike,
    interval_s: float,
    sample_rate_hz: float,
    *,
    scale: float = 1.0,
    key_bottom_s: float | None = None,
) -> TargetForce:
    """Return a recorded force on the rig's sample clock, with its first command, onset and key bottom.

    Parameters
    ----------
    name : str
        What to call it in errors.
    force_n : ndarray, shape (m,)
        Recorded force, positive downwards.
    interval_s : float
        Its sample interval, s.
    sample_rate_hz : float
        The rig's.
    scale : float
        Factor on the force, to play the blow softer or louder than it was recorded.
    key_bottom_s : float, optional
        Time of key bottom in the recording; found by itself when not given.

    Returns
    -------
    TargetForce

    Raises
    ------
    RigInputError
        When the recording is no row of finite numbers, does not begin at rest, has no blow, or no spike at key bottom.

    Examples
    --------
    >>> import model
    >>> import rig
    >>> target = rig.make_target("forte", model.force_table("thesis-forte")[1], 2e-4, 5000.0)
    >>> print(f"{target.peak_n:.0f} N")
    10 N
    """
    force_n = as_numbers(force_n, f"{name}: force", 1)
    refuse(
        RigInputError,
        (
            not np.isfinite(force_n).all(),
            f"{name}: force: found a value that is not finite, allowed finite ones; cut lost data out",
        ),
        (not (np.isfinite(scale) and scale > 0), f"{name}: scale = {scale:g}, allowed above 0"),
        (
            interval_s > LONGEST_INTERVAL_S,
            f"{name}: sampled every {interval_s:g} s, allowed at most every {LONGEST_INTERVAL_S:g} s",
        ),
        (
            force_n.size * interval_s > LONGEST_S,
            f"{name}: lasts {force_n.size * interval_s:.3g} s, allowed at most {LONGEST_S:g} s; cut out one blow",
        ),
    )
    on_clock = scale * _resample_force(force_n, interval_s, sample_rate_hz)
    quiet = max(int(round(QUIET_S * sample_rate_hz)), 2)
    if on_clock.size < 4 * quiet:
        raise RigInputError(f"{name}: lasts {on_clock.size / sample_rate_hz:.3g} s, allowed from {4 * QUIET_S:g} s")
    rest_n = float(np.mean(on_clock[:quiet]))
    force = on_clock - rest_n
    highest = float(np.max(force))
    line = np.polynomial.polynomial.Polynomial.fit(np.arange(quiet), force[:quiet], 1)
    noise = 4 * float(np.std(force[:quiet] - line(np.arange(quiet))))
    drift = abs(float(line(quiet - 1) - line(0)))
    if highest <= 0 or max(float(np.max(np.abs(force[:quiet]))), drift) > max(ONSET * highest, noise):
        raise RigInputError(
            f"{name}: does not begin with {QUIET_S:g} s of rest before a push; cut the recording earlier"
        )
    if key_bottom_s is None:
        bottom = key_bottom(force, sample_rate_hz)
        if bottom is None:
            raise RigInputError(f"{name}: no spike at key bottom was found; say when it is (`key_bottom_s`, s)")
    else:
        if not quiet < key_bottom_s * sample_rate_hz <= force.size - 1:
            raise RigInputError(
                f"{name}: key bottom at {key_bottom_s:g} s, allowed {QUIET_S:g} to {force.size / sample_rate_hz:g} s"
            )
        bottom = round(key_bottom_s * sample_rate_hz)
    peak = float(np.max(force[:bottom]))
    if peak <= 0:
        raise RigInputError(f"{name}: no push before key bottom at {bottom / sample_rate_hz:.4f} s")
    above = np.flatnonzero(force[: bottom + 1] > ONSET * peak)
    above = above[force[above] > noise]
    if not above.size:
        raise RigInputError(f"{name}: the push before key bottom does not rise above the noise, {noise:.3g} N")
    onset = int(above[0])
    while onset > 0 and max(noise, 0.0) < force[onset - 1] < force[onset]:
        onset -= 1
    return _cut_target(name, force, rest_n, onset, bottom, sample_rate_hz)


def _resample_force(force_n: NDArray[np.float64], interval_s: float, rate_hz: float) -> NDArray[np.float64]:
    """Force (m,) on the clock of ``rate_hz``, (n,): linear between samples, averaged where it was sampled faster."""
    time_s = np.arange(force_n.size) * interval_s
    n = int(np.floor(time_s[-1] * rate_hz + 1e-6)) + 1
    wanted = np.arange(n) / rate_hz
    if interval_s * rate_hz > 1 - 1e-6:
        return np.interp(wanted, time_s, force_n)
    area = np.concatenate(([0.0], np.cumsum(0.5 * (force_n[1:] + force_n[:-1]) * interval_s)))
    half = 0.5 / rate_hz
    low, high = np.clip(wanted - half, 0, time_s[-1]), np.clip(wanted + half, 0, time_s[-1])
    # the area is quadratic between samples: a linear look-up errs by less than an interval's own change
    return (np.interp(high, time_s, area) - np.interp(low, time_s, area)) / (high - low)


def key_bottom(force_n: NDArray[np.float64], rate_hz: float) -> int | None:
    """Return the sample at the foot of the spike at key bottom; None when no rise stands out."""
    width = max(int(round(SMOOTH_S * rate_hz)), 1)
    smooth = np.convolve(np.pad(force_n, (width, width), mode="edge"), np.ones(width) / width, "same")[width:-width]
    slope = np.gradient(smooth) * rate_hz
    # the first of the steep rises: a check that catches the hammer, or a bounce, may be steeper than key bottom
    steep = int(np.argmax(slope > FIRST * slope.max())) if slope.max() > 0 else 0
    top = steep + int(np.argmax(slope[steep : steep + 4 * width]))
    rise = np.flatnonzero(smooth[:top] > ONSET * smooth[top])
    start = int(rise[0]) if rise.size else top
    before = slope[start:top]
    gentle = float(np.median(before[before > 0])) if np.any(before > 0) else 0.0
    if top - start < 4 * width or slope[top] < SPIKE * gentle:
        return None
    # the foot: where the slope last was near that of the rise
    foot = top
    while foot > start and slope[foot] > gentle + FOOT * (slope[top] - gentle):
        foot -= 1
    return foot


def _cut_target(
    name: str, force: NDArray[np.float64], rest_n: float, onset: int, bottom: int, rate_hz: float
) -> TargetForce:
    """Target of a measured force (n,), N: from ``onset`` (sample), key bottom at ``bottom``, without its spike."""
    held = force.copy()
    after = min(bottom + int(SPIKE_S * rate_hz), force.size - 1)
    level = float(np.median(force[after : after + max(int(RELEASE_S * rate_hz), 1)]))
    held[bottom : after + 1] = np.interp(np.arange(bottom, after + 1), [bottom, after], [force[bottom], level])
    significant = np.flatnonzero(np.abs(held) > ONSET * np.max(force[: bottom + 1]))
    end = min(int(significant[-1]) + 1, force.size)
    lead, tail = int(round(LEAD_S * rate_hz)), max(int(round(RELEASE_S * rate_hz)), 1)
    shown = np.concatenate((np.zeros(lead), force[onset:], np.zeros(tail)))[: lead + end - onset + tail]
    command = np.concatenate((np.zeros(lead), held[onset:end], held[end - 1] * np.linspace(1, 0, tail + 1)[1:]))
    command = low_pass(command, FIRST_CUTOFF_HZ, rate_hz)
    command *= np.clip((np.arange(command.size) / rate_hz - (LEAD_S - FADE_S)) / FADE_S, 0.0, 1.0)
    command[0] = command[-1] = 0.0
    n = min(shown.size, command.size)
    return TargetForce(
        name=name,
        time_s=np.arange(n) / rate_hz,
        force_n=shown[:n],
        command_n=command[:n],
        onset_s=lead / rate_hz,
        bottom_s=(lead + bottom - onset) / rate_hz,
        rest_n=rest_n,
    )


def low_pass(values: NDArray[np.float64], cutoff_hz: float, rate_hz: float) -> NDArray[np.float64]:
    """Return values (n,) after a zero-phase low-pass of the second order, run forwards and backwards."""
    lowpass = butter(2, min(cutoff_hz, HIGHEST_CUTOFF * rate_hz), fs=rate_hz, output="sos")
    return np.asarray(sosfiltfilt(lowpass, values))


LATE_S = 0.0015  # before key bottom; a message names the share of the error that lies there
GUARD_S = 0.001  # before key bottom, where learning ends: a zero-phase filter spreads the spike backwards


@dataclass(frozen=True, eq=False)
class Measured:
    """A measured blow: force on the target's clock, N, and its key bottom, s (None: none found)."""

    force_n: NDArray[np.float64]
    bottom_s: float | None


def measured_force(data: TrialData, target: TargetForce, start_s: float) -> Measured:
    """Map a trial's force to the clock of the target, whose time zero was output at ``start_s`` of the trial.

    Resting force and mains hum, fitted to the time before the blow, are subtracted; the channel's delay and the sample
    between output and input are taken back.
    """
    force = data.raw_force_n - _resting(data)
    rate = data.sample_rate_hz
    at_s = start_s + target.time_s + data.force_info.group_delay_s + 1.0 / rate
    on_clock = np.interp(at_s, data.time_s, force)
    bottom = key_bottom(on_clock, rate)
    return Measured(on_clock, None if bottom is None else bottom / rate)


def _resting(data: TrialData) -> NDArray[np.float64]:
    """Mean and mains hum of the force before the blow, continued over the whole trial, (n,)."""
    mains_hz = np.array([data.force_info.mains_frequency_hz])
    fit = fit_mains_hum(data.time_s, data.raw_force_n, data.time_s < data.blow_start_s, mains_hz)
    return fit.rest + fit.hum


def window(target: TargetForce, measured: Measured) -> NDArray[np.bool_]:
    """Where target and measured force are compared: from the onset to the earlier key bottom."""
    end_s = target.bottom_s if measured.bottom_s is None else min(target.bottom_s, measured.bottom_s)
    return (target.time_s >= target.onset_s) & (target.time_s <= end_s)


def relative_rms(target: TargetForce, measured: Measured) -> float:
    """RMS of target less measured force before key bottom, relative to the target's peak there."""
    inside = window(target, measured)
    if not inside.any():
        return float("inf")
    error = target.force_n[inside] - measured.force_n[inside]
    return float(np.sqrt(np.mean(error**2))) / target.peak_n


def late_share(target: TargetForce, measured: Measured) -> float:
    """Fraction of the squared error before key bottom that lies in its last `LATE_S`."""
    inside = window(target, measured)
    squared = np.where(inside, (target.force_n - measured.force_n) ** 2, 0.0)
    end_s = target.time_s[inside][-1] if inside.any() else 0.0
    return float(squared[target.time_s > end_s - LATE_S].sum() / max(squared.sum(), 1e-30))


def correct_command(
    command_n: NDArray[np.float64], target: TargetForce, measured: Measured, gain: float, rate_hz: float
) -> NDArray[np.float64]:
    """Return the next command (n,), N: this one plus ``gain`` times its filtered error; zero at both ends."""
    time_s, inside = target.time_s, window(target, measured)
    error = target.force_n - measured.force_n
    error[time_s < target.onset_s - FADE_S] = 0.0
    last = max(int(np.flatnonzero(inside)[-1]) - int(GUARD_S * rate_hz), 0) if inside.any() else 0
    error[last:] = error[last]  # so that the filter meets no edge
    error = low_pass(error, CUTOFF_HZ, rate_hz)
    error[last:] *= np.exp(-np.arange(error.size - last) / (FADE_S * rate_hz))
    # the profile begins with LEAD_S of zeros: the correction comes in smoothly before the onset
    error *= np.clip((time_s - (target.onset_s - FADE_S)) / FADE_S, 0.0, 1.0)
    corrected_n = command_n + gain * error
    corrected_n[0] = corrected_n[-1] = 0.0
    return np.asarray(corrected_n)


LIMIT_SHARE = 0.98  # of the motor's limits, that a command takes: key points are rounded


def limit_command(
    command_n: NDArray[np.float64], force_limit_n: float, slew_limit_n_per_s: float, rate_hz: float
) -> NDArray[np.float64]:
    """Copy of a command, N, held within force and slew limits, by a small share below each."""
    step = LIMIT_SHARE * slew_limit_n_per_s / rate_hz
    limited = np.clip(command_n, -LIMIT_SHARE * force_limit_n, LIMIT_SHARE * force_limit_n)
    for order in (range(1, limited.size), range(limited.size - 2, -1, -1)):
        back = 1 if order.step < 0 else -1
        for k in order:
            before = limited[k + back]
            limited[k] = min(max(limited[k], before - step), before + step)
    return limited


GROWN = 1.2  # times the least error: choice; a blow of a larger one is taken to diverge
GAIN = 0.8  # of the error that one stroke corrects: below 1, so that noise is not learnt whole
GOAL = 0.03  # relative error of the force at which learning ends; needs a peak of 33 times the noise
MARGIN = 0.75  # of the goal, to which learning goes on while blows improve: a replay must follow as well
MOST_BLOWS = 50  # that a user may ask for
POINT_TOLERANCE = 0.002  # of the peak: smaller changes of the command get no key point; a fifteenth of the goal


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
    """Learn the profile that makes the measured force follow a target.

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
        profile = profile_of(target.name, command, rate, f"blow {number} of learning {target.name}")
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
    """Refuse a target that no number of blows can reach on this rig."""
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


def profile_of(name: str, command_n: NDArray[np.float64], rate_hz: float, description: str) -> Profile:
    """Profile of few points joined by lines, near a command (n,), N, sampled at a rate; it begins and ends at 0 N."""
    samples = key_points(command_n, POINT_TOLERANCE * float(np.max(np.abs(command_n), initial=1e-9)))
    points = [{"time_s": round(float(k / rate_hz), 7), "force_n": round(float(command_n[k]), 4)} for k in samples]
    points[0]["force_n"] = points[-1]["force_n"] = 0.0
    head = toml_file.dump_toml({"name": name, "description": description, "interpolation": "linear"})
    rows = "".join(f"  {{ time_s = {p['time_s']!r}, force_n = {p['force_n']!r} }},\n" for p in points)
    return parse_profile(f"{head}points = [\n{rows}]\n", name)


def key_points(values: NDArray[np.float64], tolerance: float) -> list[int]:
    """Return the samples to keep so that lines between them stay within ``tolerance`` (Ramer 1972)."""
    points, open_spans = {0, values.size - 1}, [(0, values.size - 1)]
    while open_spans:
        low, high = open_spans.pop()
        if high - low < 2:
            continue
        inner = np.arange(low + 1, high)
        away = np.abs(values[inner] - np.interp(inner, [low, high], values[[low, high]]))
        worst = int(np.argmax(away))
        if away[worst] > tolerance:
            middle = int(inner[worst])
            points.add(middle)
            open_spans += [(low, middle), (middle, high)]
    return sorted(points)
