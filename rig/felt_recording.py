"""Recording a felt, and the loading curve of each press.

The points of a curve share compliance, radius, gain, preload, delay, first touch. Each common error is carried through
the whole evaluation: with it one standard uncertainty off the curve is computed again, first touch included, and the
difference is what the file states for each point.

Readings of a press are force without delay, hum and offset, and the way of the arm's tip. Force is that above the
reading at rest plus the stated preload. Encoders are not delayed, the force of a bridge module is: without its delay
taken off, the loop would be wider by speed times delay. The arm rests on the felt with a preload, so the zero of
compression lies before the rest: fitted together are the felt's cubic (eq. 2.5), its loop as a share of the cubic, and
the way from first touch to rest; the force at rest is the preload. The compliance of arm and cell is the way of the arm
over force while it presses a block that does not give way.

A torque motor commands force, not motion: a ramp of force slows down in a felt that hardens, and a loop at a changing
speed is no constant share of the felt's curve (eq. 2.7). From the ramp's curve of force over displacement follows the
force that moves the arm at one speed, with smooth beginning and end and a rest at the peak, during which nothing rings.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Unpack

import numpy as np
from numpy.typing import NDArray

from rig.arrays import as_numbers
from rig.atomic_write import translate_os_error, write_text
from rig.backend import Backend
from rig.configuration.profile import MotorCommand, Profile, motor_command, parse_profile
from rig.configuration.rig_file import FeltConfig, Rig, RigConfig, load_rig, parse_rig
from rig.configuration.toml_file import dump_toml
from rig.errors import RigInputError
from rig.guided_calibration import change_table
from rig.keywords import make_options
from rig.mains_hum import SEARCH_HZ, fit_mains_hum
from rig.recording.begin_session import new_session
from rig.recording.options import RecordingKeywords, RecordingOptions
from rig.recording.record_entries import record_entries
from rig.recording.trial_plan import Entry
from rig.safety.dry_run import PredictedBlow, dry_run
from rig.safety.permission import require_permission
from rig.session.folder import Session, Trial
from rig.session.info import FileInfo, PlanInfo
from rig.session.trial_data import TrialData

BINS = 160  # points of a phase at most, means over equal times: a curve file of some 300 lines
FEWEST_SAMPLES = 3  # of a point, so that a spike is averaged
FEWEST_POINTS = 10  # of a phase: a cubic with its loop and first touch has five unknowns
EASE = 0.12  # share of the way over which the speed is reached, and left: choice; shorter rings more
LOWEST, HIGHEST = 0.5 * EASE, 1.0 - 0.5 * EASE  # share of the way that counts: at full speed
SETTLED_S = 0.15  # at the end of a press, in which the arm rests: seven periods of 50 Hz
HUM_GRID = 41  # mains frequencies that are tried: 0.01 Hz apart, a tenth of a turn in ten seconds
LEAST_COUNTS = 20  # turn of the encoder: the rounding of a count, u = 0.29, is then at most 1.5 % of it
Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Readings:
    """Means over short times: the way of the tip since rest, m, the force, N, its rate, N/s, loading first.

    ``samples`` are the samples of each mean; ``loading`` is true for the first phase; ``count_m`` is the way of one
    count, ``u_force_n`` the scatter of the force from sample to sample.
    """

    moved_m: Array
    force_n: Array
    rate_n_per_s: Array
    samples: NDArray[np.int64]
    loading: NDArray[np.bool_]
    count_m: float
    u_force_n: float
    peak_n: float


def readings(trial: TrialData, felt: FeltConfig, lowest: float = LOWEST) -> Readings:
    """Cut press and release out of a trial.

    Parameters
    ----------
    lowest : from which share of the way on; 0 takes the beginning as well, where the speed is still growing
    """
    force, rate = trial.force_info, trial.sample_rate_hz
    body = [encoder.name for encoder in trial.encoders].index(felt.encoder)
    per_count = abs(trial.encoders[body].rad_per_count) * felt.radius_m
    counts = trial.encoder_count[:, body].astype(np.float64)
    quiet = int(trial.blow_start_s * rate)
    turned = counts - counts[:quiet].mean()
    displacement_m = turned * per_count * np.sign(turned[int(np.argmax(np.abs(turned)))])
    if np.abs(turned).max() < LEAST_COUNTS:
        raise RigInputError(
            f"trial {trial.number}: the {felt.encoder} encoder turned by {np.abs(turned).max():.0f} counts, allowed "
            f"from {LEAST_COUNTS}; is its scale on the motor's shaft (felt.encoder), and the arm on the felt?"
        )
    felt_n, scatter = _pressing_force(trial, quiet)
    k = np.arange(trial.n_valid) + force.group_delay_s * rate
    felt_n = np.interp(k, np.arange(trial.n_valid), felt_n)
    change = np.gradient(felt_n) * rate
    top = float(displacement_m.max())
    inside = np.flatnonzero(displacement_m >= HIGHEST * top)
    # between the phases the arm rests at the peak
    rise = _phase_span(displacement_m, quiet, int(inside[0]), lowest * top)
    last = min(trial.n_valid - int(np.ceil(force.group_delay_s * rate)) - 1, displacement_m.size)
    fall = _phase_span(displacement_m[last - 1 :: -1], 0, last - 1 - int(inside[-1]), lowest * top)
    fall = (last - fall[1], last - fall[0])
    parts = [_bin_means(span, displacement_m, felt_n, change) for span in (rise, fall)]
    columns = [np.concatenate([part[k] for part in parts]) for k in range(4)]
    return Readings(
        moved_m=columns[0],
        force_n=columns[1],
        rate_n_per_s=columns[2],
        samples=columns[3].astype(np.int64),
        loading=np.arange(columns[0].size) < parts[0][0].size,
        count_m=per_count,
        u_force_n=scatter,
        peak_n=float(felt_n[quiet:].max()),
    )


def loading_speed(
    x_m: Array, loading: NDArray[np.bool_], samples: NDArray[np.int64], rate_hz: float
) -> tuple[float, float]:
    """Return the mean speed of the first phase, m/s, and that of its last third, where the loop is widest."""
    at = np.cumsum(samples[loading]) / rate_hz
    x = x_m[loading]
    last = x > x[-1] * 2.0 / 3.0
    return float(np.polyfit(at, x, 1)[0]), float(np.polyfit(at[last], x[last], 1)[0])


def _pressing_force(trial: TrialData, quiet: int) -> tuple[Array, float]:
    """Force above rest plus preload, without mains hum, and its scatter from sample to sample, N."""
    t, n = trial.time_s, trial.n_valid
    calm = np.zeros(n, dtype=bool)
    calm[: max(quiet, 1)] = True
    calm[-int(SETTLED_S * trial.sample_rate_hz) :] = True
    late = np.arange(n) > n // 2
    nominal = trial.force_info.mains_frequency_hz
    rest = np.column_stack([~late, late]).astype(float)  # a felt that has not come back rests at another force
    fit = fit_mains_hum(t, trial.raw_force_n, calm, nominal + np.linspace(-SEARCH_HZ, SEARCH_HZ, HUM_GRID), rest)
    scatter = float(np.sqrt(np.mean(fit.residual**2)))
    return trial.raw_force_n - fit.hum - fit.rest[0] + trial.force_info.preload_n, scatter


def _phase_span(moved: Array, start: int, top: int, low: float) -> tuple[int, int]:
    """First sample after the last one below ``low``, up to the first one that has reached the top."""
    below = np.flatnonzero(moved[start:top] < low)
    first = start + (int(below[-1]) + 1 if below.size else 0)
    fewest = FEWEST_POINTS * FEWEST_SAMPLES
    if top - first < fewest:
        raise RigInputError(
            f"felt: a phase of {top - first} samples, allowed from {fewest}; press more slowly or harder"
        )
    return first, top


def _bin_means(span: tuple[int, int], *series: Array) -> tuple[Array, ...]:
    """Means over equal times, and how many samples each has."""
    first, end = span
    bins = min(BINS, (end - first) // FEWEST_SAMPLES)
    edges = np.linspace(first, end, bins + 1).astype(int)
    size = np.diff(edges)
    return *(np.add.reduceat(one[:end], edges[:-1]) / size for one in series), size.astype(np.float64)


DEEPEST_REST = 0.5  # share of the way that the preload may have taken up: beyond it the start of the curve is guessed
PRELOAD_SHARE = 0.1  # of a reading's u, to which the curve meets the preload; its own error is common to all points


def first_touch(
    moved_m: Array, force_n: Array, loading: NDArray[np.bool_], u_n: Array, preload_n: float
) -> tuple[float, float]:
    """Fit the compression at rest; return it, m, and the standard uncertainty that the readings' scatter gives it.

    Parameters
    ----------
    moved_m, force_n : (n,) compression since rest, force of the felt
    u_n : (n,) standard uncertainty of a reading as a force
    preload_n : force at rest
    """
    from scipy.optimize import least_squares  # start-up: 0.2 s that only the press of a felt needs

    span, top = float(moved_m.max()), float(force_n.max())
    sense = np.where(loading, 1.0, -1.0)
    u_preload = PRELOAD_SHARE * float(np.median(u_n))

    def residual(p: Array) -> Array:
        a, b, c, rest, share = p
        x = moved_m / span + rest
        at_rest = (((a * rest + b) * rest + c) * rest - preload_n / top) * top / u_preload
        fit = (((a * x + b) * x + c) * x) * (1.0 + share * sense)
        return np.append((fit - force_n / top) * top / u_n, at_rest)

    start = np.polyfit(moved_m / span, force_n / top, 3)
    slope = max(start[2], 4.0 * preload_n / top, 1e-3)  # so that the rest begins at a quarter of the way at most
    guess = np.array([start[0], start[1], slope, preload_n / top / slope, 0.0])
    fit = least_squares(
        residual,
        guess,
        bounds=([-np.inf, -np.inf, 0.0, 0.0, -0.5], [np.inf, np.inf, np.inf, DEEPEST_REST, 0.5]),
        x_scale="jac",
    )
    rest = float(fit.x[3])
    if not fit.success or not 0.0 <= rest < DEEPEST_REST - 1e-3:
        raise RigInputError(
            f"felt: first touch not found: at rest the felt would be compressed by {1e3 * rest * span:.3g} mm of "
            f"{1e3 * span:.3g} mm; look at force.preload_n, or lighten the preload"
        )
    freedom = max(moved_m.size + 1 - guess.size, 1)
    widened = max(2.0 * float(fit.cost) / freedom, 1.0)
    covariance = np.linalg.pinv(fit.jac.T @ fit.jac) * widened
    return rest * span, float(np.sqrt(covariance[3, 3])) * span


PHASES = ("loading", "unloading")


@dataclass(frozen=True, eq=False)
class PressCurve:
    # displacement_m, force_n: (n,) compression since first touch and force of the felt, in the order measured
    displacement_m: Array
    force_n: Array
    loading: NDArray[np.bool_]  # (n,) true for the first phase
    # by name, (2, n) change of displacement and force if that error were one standard uncertainty
    common: dict[str, Array]
    # speed_m_per_s, u_speed_m_per_s: rate of compression while loading, towards the peak, where the loop is read
    speed_m_per_s: float
    u_speed_m_per_s: float
    swing: float  # by what share the speed near the peak, which is the one stated, differs from that of the whole way
    # peak_n, deepest_m: largest force and compression
    peak_n: float
    deepest_m: float

    def table(self) -> str:
        """Return the curve as ``calibrate felt`` reads it, CSV."""
        names = ["displacement_m", "force_n", "phase"]
        names += [f"common_{name}_{unit}" for name in self.common for unit in ("m", "n")]
        shared = [row for moved in self.common.values() for row in moved]
        lines = [",".join(names)]
        for k, (x, f, first) in enumerate(zip(self.displacement_m, self.force_n, self.loading, strict=True)):
            cells = [f"{x:.9g}", f"{f:.9g}", PHASES[0] if first else PHASES[1]]
            lines.append(",".join([*cells, *(f"{row[k]:.4g}" for row in shared)]))
        return "\n".join(lines) + "\n"


@dataclass(frozen=True)
class _Truth:
    """What the evaluation takes for true."""

    compliance: float
    length: float = 1.0
    gain: float = 1.0
    preload_n: float = 0.0
    delay_s: float = 0.0


def press_curve(trial: TrialData, felt: FeltConfig) -> PressCurve:
    """Evaluate a press.

    Parameters
    ----------
    felt : ``[felt]`` of the rig file it was recorded with
    """
    read, force = readings(trial, felt), trial.force_info
    scale = next(encoder for encoder in trial.encoders if encoder.name == felt.encoder)
    u_length = float(np.hypot(felt.u_radius_m / felt.radius_m, scale.u_turn_relative))
    known = _Truth(felt.compliance_m_per_n, preload_n=force.preload_n)
    x, f, u_rest = _compression_and_force(read, known, force.preload_n)
    off = {
        "compliance": replace(known, compliance=known.compliance + felt.u_compliance_m_per_n),
        "length": replace(known, length=1.0 + u_length),
        "gain": replace(known, gain=1.0 + force.u_gain_relative),
        "preload": replace(known, preload_n=known.preload_n + force.u_preload_n),
        "delay": replace(known, delay_s=force.u_group_delay_s),
    }
    common = {}
    for name, other in off.items():
        moved, pressed, _ = _compression_and_force(read, other, force.preload_n)
        common[name] = np.vstack((moved - x, pressed - f))
    # the divided line signal of the scale: its error comes back with each line; a line as long as the press bends most
    wave = 2 * np.pi * read.moved_m / float(np.ptp(read.moved_m))
    for name, shape in (("division_sin", np.sin(wave)), ("division_cos", np.cos(wave) - 1.0)):
        swept = np.sqrt(2.0) * scale.u_interpolation_rad * felt.radius_m * shape
        common[name] = np.vstack((swept, np.zeros(x.size)))
    common["first_touch"] = np.vstack((np.full(x.size, u_rest), np.zeros(x.size)))
    mean, speed = loading_speed(x, read.loading, read.samples, trial.sample_rate_hz)
    swing = speed / mean - 1.0
    # by the scale, by a count at its ends, and by what it changes on the way
    by_count = read.count_m / float(read.samples[read.loading].sum()) * trial.sample_rate_hz
    u_speed = float(np.sqrt((speed * u_length) ** 2 + by_count**2 + (speed * swing) ** 2))
    return PressCurve(x, f, read.loading, common, speed, u_speed, swing, read.peak_n, float(x.max()))


def _compression_and_force(read: Readings, known: _Truth, stated_preload_n: float) -> tuple[Array, Array, float]:
    """Compression and force of the felt, and the standard uncertainty of the compression at rest."""
    force = (read.force_n - stated_preload_n + read.rate_n_per_s * known.delay_s) * known.gain + known.preload_n
    compression_m = read.moved_m * known.length - known.compliance * (force - known.preload_n)
    slope = np.abs(np.gradient(force[read.loading], compression_m[read.loading]))
    at = np.interp(compression_m, compression_m[read.loading], slope)
    u = np.hypot(read.u_force_n, at * read.count_m / np.sqrt(12.0)) / np.sqrt(read.samples)
    rest_m, u_rest_m = first_touch(compression_m, force, read.loading, u, known.preload_n)
    return compression_m + rest_m, force, u_rest_m


ABOVE_N = 2.0  # on the block: below, surfaces that are not flat yet give way


@dataclass(frozen=True)
class Compliance:
    """Compliance with its standard uncertainty, m/N, and how far the readings are from a straight line, m."""

    m_per_n: float
    u_m_per_n: float
    crooked_m: float


def compliance(trials: Sequence[TrialData], felt: FeltConfig) -> Compliance:
    """Fit way over force of presses on a block."""
    slopes, crooked = [], 0.0
    for trial in trials:
        read = readings(trial, felt)
        hard = read.force_n > ABOVE_N
        if hard.sum() < 2 * FEWEST_POINTS:
            raise RigInputError(
                f"trial {trial.number}: {read.peak_n:.3g} N on the block, allowed well above {ABOVE_N:g} N"
            )
        line = np.polyfit(read.force_n[hard], read.moved_m[hard], 1)
        left = read.moved_m[hard] - np.polyval(line, read.force_n[hard])
        crooked = max(crooked, float(np.abs(left).max()))
        # a count read once too many at one end tilts the line; more readings do not make the scale finer
        slopes.append((float(line[0]), read.count_m / np.sqrt(12.0) / float(np.ptp(read.force_n[hard]))))
    values = np.array([slope for slope, _ in slopes])
    mean = float(values.mean())
    scatter = float(values.std(ddof=1)) if values.size > 1 else 0.0
    force, encoder = trials[0].force_info, next(e for e in trials[0].encoders if e.name == felt.encoder)
    relative = np.hypot(force.u_gain_relative, np.hypot(felt.u_radius_m / felt.radius_m, encoder.u_turn_relative))
    u = float(np.sqrt((mean * relative) ** 2 + scatter**2 / values.size + max(u for _, u in slopes) ** 2))
    if mean <= 0:
        raise RigInputError(f"block: compliance found {mean:.3g} m/N, allowed above 0; look at the encoder's mounting")
    return Compliance(mean, u, crooked)


BLOCK = "block"
"""What is pressed to measure the compliance of arm and cell: a block of steel."""
SLOWEST_M_PER_S, FASTEST_M_PER_S = 1e-4, 0.2  # of a press: a millimetre in ten seconds; in 5 ms, below a blow's 1 m/s
MOST_REPEATS, LONGEST_REST_S = 100, 3600.0  # that may be asked for: a typing error is larger


@dataclass(frozen=True)
class FeltOrder:
    """One loading experiment.

    Attributes
    ----------
    contact : name of the felt, for example ``contact02``, or ``block``
    speeds_m_per_s, peaks_n : each speed is played with each peak force
    repeats : presses of each kind
    rest_s : between two presses, for the felt to recover
    """

    contact: str
    speeds_m_per_s: Sequence[float] = (0.002, 0.008, 0.02)  # choice: a decade, below ringing
    peaks_n: Sequence[float] = (15.0, 30.0)  # choice: half and whole of a forte
    repeats: int = 1
    rest_s: float = 2.0  # choice; a felt that still recovers shows in the first touch

    def __post_init__(self) -> None:
        for name in ("speeds_m_per_s", "peaks_n"):
            object.__setattr__(self, name, tuple(as_numbers(getattr(self, name), f"felt: {name}", 1).tolist()))


def check_order(order: FeltOrder, config: RigConfig, source: str) -> FeltConfig:
    """Return the rig file's ``[felt]`` after a check of the order against it."""
    felt = config.felt
    if felt is None:
        raise RigInputError(
            f"{source}: has no table [felt]; add radius_m and compliance_m_per_n of the arm as in the built-in rig "
            "'virtual'"
        )
    if not order.speeds_m_per_s or not order.peaks_n:
        raise RigInputError("felt: allowed from one speed and one peak force on")
    for speed in order.speeds_m_per_s:
        if not SLOWEST_M_PER_S <= speed <= FASTEST_M_PER_S:
            raise RigInputError(f"felt: speed {speed:g} m/s, allowed {SLOWEST_M_PER_S:g} to {FASTEST_M_PER_S:g} m/s")
    for peak in order.peaks_n:
        if not 1.0 <= peak <= felt.force_limit_n:
            raise RigInputError(
                f"felt: peak force {peak:g} N, allowed 1 to {felt.force_limit_n:g} N (felt.force_limit_n)"
            )
    if not 1 <= order.repeats <= MOST_REPEATS or not 0 <= order.rest_s <= LONGEST_REST_S:
        raise RigInputError(
            f"felt: {order.repeats} repeats, rest {order.rest_s:g} s; allowed 1 to {MOST_REPEATS}, "
            f"0 to {LONGEST_REST_S:g} s"
        )
    return felt


SPEED_MARGIN, FORCE_MARGIN = 5.0, 1.1  # interlock's limits over what a press should reach: room for ringing


def press_settings(config: RigConfig, felt: FeltConfig, peak_n: float) -> RigConfig:
    """Return the settings of a press: no camera, the limits of force and travel those of a felt."""
    limits, body = config.limits, [encoder.name for encoder in config.encoders].index(felt.encoder)
    travel, speed = list(limits.travel_rad), list(limits.speed_rad_per_s)
    travel[body] = (felt.depth_limit_m + felt.compliance_m_per_n * felt.force_limit_n) / felt.radius_m
    speed[body] = SPEED_MARGIN * FASTEST_M_PER_S / felt.radius_m
    narrowed = limits.model_copy(
        update={
            "force_max_n": min(limits.force_max_n, FORCE_MARGIN * peak_n + 1.0, FORCE_MARGIN * felt.force_limit_n),
            "travel_rad": tuple(travel),
            "speed_rad_per_s": tuple(speed),
        }
    )
    return config.model_copy(update={"camera": None, "limits": narrowed})


RAMP_S = 1.5  # of the first press, each way
HOLD_S = 0.08  # at the deepest point, between loading and unloading
POINTS = 60  # key points of a press, straight lines between them
SLEW_SHARE = 0.9  # of the rig file's slew limit that a press may ask for


def ramp(peak_n: float) -> Profile:
    """Return the slow press: a smooth ramp to the peak, a rest, and back."""
    phase = np.linspace(0.0, 1.0, POINTS)
    rise = _ease_in_out(phase)
    return _mirror_profile("ramp", RAMP_S * phase, peak_n * rise)


def constant_speed_press(
    moved_m: Array, force_n: Array, speed_m_per_s: float, peak_n: float, slew_n_per_s: float
) -> Profile:
    """Return the press that moves the felt's surface at one speed.

    Parameters
    ----------
    moved_m, force_n : (k,) way since the arm's rest and force above its preload, both rising from 0, as the ramp found
    speed_m_per_s, peak_n : wanted
    slew_n_per_s : fastest change of force that the rig file allows
    """
    way = float(np.interp(peak_n, force_n, moved_m))
    phase = np.linspace(0.0, 1.0, POINTS)
    displacement_m = way * _ease_in_out(phase)
    duration = way * (1.0 + EASE) / speed_m_per_s
    force = np.interp(displacement_m, moved_m, force_n)
    force *= peak_n / force[-1]
    steepest = float(np.max(np.diff(force))) * (POINTS - 1) / duration
    if steepest > SLEW_SHARE * slew_n_per_s:
        allowed = SLEW_SHARE * slew_n_per_s
        raise RigInputError(
            f"felt: {speed_m_per_s:g} m/s to {peak_n:g} N needs {steepest:.4g} N/s, allowed {allowed:g} N/s "
            f"(motor.slew_limit_n_per_s); press at {speed_m_per_s * allowed / steepest:.2g} m/s at most, or less hard"
        )
    return _mirror_profile(f"{1e3 * speed_m_per_s:g} mm/s to {peak_n:g} N", duration * phase, force)


def checked_command(profile: Profile, config: RigConfig, deepest_rad: float, body: int) -> MotorCommand:
    """Return the motor command of a press after a dry run without inertia: the force follows the command."""
    rate = config.device.sample_rate_hz
    force = profile.sample(rate)
    angle = np.zeros((force.size, 3))
    angle[:, body] = deepest_rad * force / max(float(force.max()), 1e-9)
    speed = np.diff(angle, axis=0, append=angle[-1:]) * rate
    predicted = PredictedBlow(np.arange(force.size) / rate, force, angle, speed, "a felt without inertia")
    dry_run(profile, config, lambda _: predicted)
    return motor_command(profile, config)


def _ease_in_out(phase: Array) -> Array:
    """Way over time, both from 0 to 1: constant speed between a smooth beginning and a smooth end."""
    eased = EASE / (1.0 + EASE)
    near = np.minimum(phase, 1.0 - phase)
    u = np.minimum(near / eased, 1.0)  # the speed is 3 u^2 - 2 u^3
    way = (eased * (u**3 - 0.5 * u**4 - u) + near) / (1.0 - eased)
    return np.where(phase < 0.5, way, 1.0 - way)


def _mirror_profile(name: str, time_s: Array, force_n: Array) -> Profile:
    """Profile of a press and its release: the force (n,), N, over times, s, held, then run backwards."""
    at = np.concatenate((time_s, time_s[-1] + HOLD_S + time_s))
    force = np.concatenate((force_n, force_n[::-1]))
    force[0] = force[-1] = 0.0
    points = [{"time_s": float(f"{t:.7g}"), "force_n": float(f"{f:.7g}")} for t, f in zip(at, force, strict=True)]
    table = {
        "name": name,
        "description": "a press and its release, made by `pianorig record --felt`",
        "interpolation": "pchip",
        "points": points,
    }
    return parse_profile(dump_toml(table), name)


FOLDER = Path("derived") / "felt"
BLOCK_PRESSES = 3  # of the steel block, whose slopes' scatter is the compliance's uncertainty


@dataclass(frozen=True, eq=False)
class FeltPress:
    """A press: its trial, its curve, and the file for ``calibrate felt``."""

    trial: int
    curve: PressCurve
    file: Path


@dataclass(frozen=True, eq=False)
class FeltSession:
    """The session with its presses of a felt, or for a block the compliance and the rig file that follows."""

    session: Session
    presses: tuple[FeltPress, ...] = ()
    compliance: Compliance | None = None
    rig_text: str = ""


def record_felt(out: str | Path, order: FeltOrder, **keywords: Unpack[RecordingKeywords]) -> FeltSession:
    """Press a felt, or the block, and evaluate it.

    Parameters
    ----------
    out : path
        Session folder to create; must not exist, or be empty.
    order : FeltOrder
        What is pressed, how fast and how hard.
    **keywords
        As for :func:`rig.recording.recorder.record`, without profile, plan, trials and predict: the dry run of a press
        needs no model.

    Returns
    -------
    FeltSession

    Raises
    ------
    RigInputError
        Bad rig file, order or path, a felt too hard for a speed, or readings that cannot be evaluated.
    NotPermitted
        Hardware without permission or self-test.
    HardwareFault
        The bench stopped, or a limit was exceeded; earlier presses are kept.

    Examples
    --------
    >>> import rig
    >>> order = rig.FeltOrder("contact02", speeds_m_per_s=(0.01,), peaks_n=(20.0,))
    >>> done = rig.record_felt("sessions/felt", order, backend="sim://?felt=contact02")
    >>> print(f"{done.presses[0].curve.peak_n:.0f} N")
    20 N
    """
    options = make_options(RecordingOptions, "rig.record_felt", keywords)
    rig = options.rig_config if isinstance(options.rig_config, Rig) else load_rig(options.rig_config)
    felt = check_order(order, rig.config, rig.source)
    known = options.permission.applied_to(rig.config) if options.permission is not None else rig.config
    press = _Press(order, rig, press_settings(known, felt, max(order.peaks_n)), felt, options)
    press.command(ramp(max(order.peaks_n)))
    with new_session(out, options, rig) as (backend, create):
        require_permission(rig, backend.capabilities, options.permission, dry_run=True)
        session = create({}, **press.session_statement())
        return press.block(session, backend) if order.contact == BLOCK else press.felt(session, backend)


@dataclass(frozen=True, eq=False)
class _Press:
    order: FeltOrder
    rig: Rig
    config: RigConfig
    setup: FeltConfig
    options: RecordingOptions

    @property
    def count(self) -> int:
        order = self.order
        return (
            BLOCK_PRESSES
            if order.contact == BLOCK
            else 1 + len(order.speeds_m_per_s) * len(order.peaks_n) * order.repeats
        )

    def session_statement(self) -> dict[str, Any]:
        """What a session of presses states of itself."""
        pressed = f"the arm pressed {self.order.contact}, no key; scale of the {self.setup.encoder} on its shaft"
        return {
            "kind": "felt",
            "profile": FileInfo(name=f"felt {self.order.contact}"),
            "plan": PlanInfo(trials=self.count, rest_s=self.order.rest_s),
            "notes": {
                "recording": pressed,
                **(self.options.permission.session_notes() if self.options.permission else {}),
            },
        }

    def command(self, profile: Profile) -> None:
        body = [encoder.name for encoder in self.config.encoders].index(self.setup.encoder)
        checked_command(profile, self.config, (1 - 1e-6) * self.config.limits.travel_rad[body], body)

    def evaluate_press(self, session: Session, trial: Trial) -> FeltPress:
        """Evaluate a press and write its curve."""
        curve = press_curve(trial.read(), self.setup)
        folder = session.path / FOLDER
        with translate_os_error(folder, "created"):
            folder.mkdir(parents=True, exist_ok=True)
        file = folder / f"trial_{trial.number:04d}.csv"
        write_text(file, curve.table())
        return FeltPress(trial.number, curve, file)

    def play(
        self,
        session: Session,
        backend: Backend,
        profiles: Sequence[Profile],
        first: int,
        options: RecordingOptions | None = None,
    ) -> None:
        """Record these presses as the trials from ``first`` on."""
        for profile in profiles:
            self.command(profile)
        entries = [Entry(first + k, f"press-{first + k}", profile) for k, profile in enumerate(profiles)]
        for entry in entries:
            write_text(session.path / f"profile_{entry.number:04d}.toml", entry.profile.text)
        record_entries(session, backend, self.config, entries, options or self.options, first_number=first)

    def block(self, session: Session, backend: Backend) -> FeltSession:
        self.play(session, backend, [ramp(max(self.order.peaks_n))] * BLOCK_PRESSES, 1)
        found = compliance([trial.read() for trial in session.trials], self.setup)
        values = {"compliance_m_per_n": found.m_per_n, "u_compliance_m_per_n": found.u_m_per_n}
        text = change_table(self.rig.text, "felt", {key: float(f"{value:.6g}") for key, value in values.items()})
        parse_rig(text, f"{self.rig.source} with the compliance found")
        return FeltSession(session, compliance=found, rig_text=text)

    def felt(self, session: Session, backend: Backend) -> FeltSession:
        order = self.order
        self.play(session, backend, [ramp(max(order.peaks_n))], 1)
        moved, force = _rising(session, self.setup)
        slew = self.config.motor.slew_limit_n_per_s
        shaped = [
            constant_speed_press(moved, force, speed, peak, slew)
            for peak in order.peaks_n
            for speed in order.speeds_m_per_s
            for _ in range(order.repeats)
        ]
        backend.wait(order.rest_s)
        presses: list[FeltPress] = []

        def evaluate(trial: Trial) -> None:
            # at once: what ends the recording later takes no curve with it
            presses.append(self.evaluate_press(session, trial))
            if self.options.after_trial is not None:
                self.options.after_trial(trial)

        self.play(session, backend, shaped, 2, replace(self.options, after_trial=evaluate))
        return FeltSession(session, tuple(presses))


def _rising(session: Session, felt: FeltConfig) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Compression since rest and force above the preload while the ramp loads, both rising from zero."""
    trial = session.trials[0].read()
    read = readings(trial, felt, lowest=0.0)
    force = read.force_n[read.loading] - trial.force_info.preload_n
    compression_m = read.moved_m[read.loading] - felt.compliance_m_per_n * force
    order = np.argsort(force)
    force, compression_m = force[order], np.maximum.accumulate(compression_m[order])
    above = (force > 0) & (compression_m > 0)
    if above.sum() < FEWEST_POINTS:
        raise RigInputError("felt: the ramp moved nothing; is the arm on the felt, the drive on?")
    return np.concatenate(([0.0], compression_m[above])), np.concatenate(([0.0], force[above]))
