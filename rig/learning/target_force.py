"""The force to reproduce: a recorded blow on the sample clock, its key bottom, and the first command for it.

Time zero is `LEAD_S` before the force first rises; the resting force before that is subtracted; the force ends at zero.
Key bottom is the foot of the steepest rise (thesis Figs 3.6 to 3.8: the force rises gradually, then spikes at key
bottom), or is given. After it the command is the sustained force without the spike, since arm and finger differ there.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.signal import butter, sosfiltfilt

from rig.arrays import ArrayRecord, as_numbers
from rig.errors import RigInputError, refuse

LEAD_S = 0.05  # before the force rises, as in the thesis's profiles
QUIET_S = 0.01  # rest that a recording must begin with: its mean and drift are the zero
LONGEST_INTERVAL_S = QUIET_S / 2  # between samples of a recording: two tell the rest's mean and drift
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
    """Return a recorded force (m,), N, positive downwards, one every ``interval_s``, times ``scale`` and above rest on
    the rig's clock, with first command, onset and key bottom (``key_bottom_s``; found where None). It must begin at
    rest.

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
        bottom = find_key_bottom(force, sample_rate_hz)
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
    """Return a force (m,), sampled every ``interval_s`` s, at the times (n,) of a clock of ``rate_hz``: linear between
    samples, or the mean over one interval of the clock where it was sampled faster."""
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


def find_key_bottom(force_n: NDArray[np.float64], rate_hz: float) -> int | None:
    """Return the sample number at the foot of the spike by which key bottom shows in a force (n,), N; None where no
    rise is much steeper than the one before it."""
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
    """Target of a force (n,), N, from sample ``onset``, 50 ms of zeros before it, to its end; its first command leaves
    the spike after key bottom, sample ``bottom``, out. ``rest_n``: resting force already subtracted, only stored."""
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
