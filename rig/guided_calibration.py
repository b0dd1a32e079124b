"""Guided calibrations on the bench, the motor off throughout: load cell, scale of an encoder, friction of a joint.

Encoder: a scale off its centre by e reads e sin(angle + phase) / radius too much; over the few degrees of an action
that is a factor, which no certificate of the scale knows. It follows from readings at reference angles (an
autocollimator's, or gauge blocks over a lever). The encoder counts through all of them in one acquisition: a stopped
counter would lose its zero.

Joint: its body is let go once and swings until it rests. Between two turning points the joint takes its share of the
energy: speed squared / 2 = w^2 cos(angle - hanging) - s f angle + constant, s the sense of the swing, f friction over
inertia. All of it is linear in the unknowns, so that every sample counts and neither where the body hangs nor how far
it was lifted need be known. f / w^2 is the friction as a share of weight times arm.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rig.arrays import as_numbers
from rig.backend import CALL_TIMEOUT_S, CALM_BLOCK_S, Backend, Block
from rig.configuration.rig_file import BODIES, EncoderConfig, Rig, RigConfig, parse_rig
from rig.configuration.toml_file import toml_value
from rig.errors import RigInputError
from rig.selftest import SelftestBackend

Array = NDArray[np.float64]
Value = str | float | int | tuple[float, float]


@dataclass(frozen=True)
class LineFit:
    """Reading = ``zero`` + ``slope`` x reference; standard uncertainties from the scatter about the line.

    ``worst`` is the largest distance from the line, ``hysteresis`` the largest difference of readings at one reference
    value, both in units of the reading.
    """

    zero: float
    slope: float
    u_zero: float
    u_slope: float
    worst: float
    hysteresis: float


LARGEST_U_SLOPE = 0.2  # of the slope: five standard uncertainties from none


def fit_line(reference: ArrayLike, reading: ArrayLike, where: str) -> LineFit:
    """Fit a line by least squares.

    The scatter is that about the line (n - 2 degrees of freedom), so that nonlinearity and hysteresis are in the
    uncertainty.
    """
    from scipy.stats import linregress  # start-up: half a second that only a calibration needs

    x, y = as_numbers(reference, where, 1), as_numbers(reading, where, 1)
    if x.size < 4 or np.unique(x).size < 3:  # two unknowns, and at least one more value that can contradict
        raise RigInputError(f"{where}: {x.size} readings at {np.unique(x).size} values, allowed from 4 at 3 values")
    line = linregress(x, y)
    off = y - line.intercept - line.slope * x
    if line.slope == 0.0 or not np.isfinite(line.slope) or line.stderr >= LARGEST_U_SLOPE * abs(line.slope):
        raise RigInputError(
            f"{where}: the readings do not follow the values ({line.slope:.4g}, u {line.stderr:.2g}); look at the "
            "wiring"
        )
    hysteresis = max(np.ptp(y[x == value]) for value in np.unique(x))
    stated = (line.intercept, line.slope, line.intercept_stderr, line.stderr, np.abs(off).max(), hysteresis)
    return LineFit(*map(float, stated))


def change_table(text: str, table: str, values: Mapping[str, Value], *, named: str | None = None) -> str:
    """Return a rig file's text with values of one table set.

    Parameters
    ----------
    table : ``force`` for ``[force]``, ``encoders`` for ``[[encoders]]``
    named : ``name`` of the table where there are several
    """
    heads = list(re.finditer(r"(?m)^\[\[?[^\[\]]+\]\]?[^\n]*$", text))
    for head, following in zip(heads, [*heads[1:], None], strict=True):
        end = len(text) if following is None else following.start()
        body = text[head.end() : end]
        if head.group(0).split("]")[0].strip("[ ") != table:
            continue
        if named is not None and not re.search(rf'(?m)^\s*name\s*=\s*"{re.escape(named)}"', body):
            continue
        for key, value in values.items():
            body = _set_value(body, key, toml_value(value))
        return text[: head.end()] + body + text[end:]
    raise RigInputError(f"rig file: has no table [{table}]" + (f" named {named}" if named else ""))


def rewritten(rig: Rig, table: str, values: Mapping[str, Value], *, named: str | None = None) -> str:
    """Return the text as :func:`change_table` does, after checking that it is a rig file still.

    With values that are there already it tells, before anything is read, whether what is read can be written.
    """
    text = change_table(rig.text, table, values, named=named)
    try:
        parse_rig(text, f"{rig.source} as calibrated")
    except RigInputError as error:
        raise RigInputError(f"{error}; write the keys of [{table}] as  key = value") from None
    return text


def _set_value(body: str, key: str, value: str) -> str:
    """Replace a value up to its comment, or add the line below the table's head."""
    line = re.compile(
        rf'(?m)^([ \t]*{re.escape(key)}\s*=\s*)("(?:[^"\\\n]|\\.)*"|\[[^\]]*\]|\{{[^}}\n]*\}}|[^#\n]*?)(\s*(?:#.*)?)$'
    )
    if line.search(body):
        return line.sub(lambda match: match[1] + value + match[3], body, count=1)
    return f"\n{key} = {value}{body}"


def read_quiet(
    backend: Backend, config: RigConfig, block_s: float, longest_s: float, take: Callable[[Block, float], bool]
) -> None:
    """Hand on blocks of ``block_s`` and the sample rate, without a motor task, until ``take`` has enough.

    The backend is stopped safely in any case; at most ``longest_s`` are read.
    """
    timing = backend.configure(config.model_copy(update={"camera": None, "watchdog": None}), None)
    rate = timing.sample_rate_hz
    size = max(int(block_s * rate), 1)
    try:
        backend.arm(enable_drive=False)
        backend.start()
        for _ in range(int(longest_s * rate) // size):
            if take(backend.read_block(size, CALL_TIMEOUT_S), rate):
                break
    finally:
        backend.safe_stop()


READ_S = 2.0  # of a mean, cut to whole mains periods
SETTLE_S = 0.3  # left out after the operator says the mass hangs
STANDARD_GRAVITY, U_GRAVITY = 9.80665, 0.015  # m/s^2; from equator to poles it differs by less than 0.03
U_LOCAL_GRAVITY = 1e-4  # of a stated local one, relative: a hundred metres of height change a third of it
LARGEST_CORRECTION = 0.1  # of a gain: a larger one is a wrong scale, wire or sign, no error of the sensor
SHUNT_STEPS = 5  # readings with the shunt: their scatter is known to a third
Found = dict[str, float | str | list[float]]
Ask = Callable[[str, float], None]
"""Shows an instruction, with the mass that is to hang on the cell, kg, and returns when it is done."""


@dataclass(frozen=True)
class Calibration:
    """One calibration: what was found, by name; the rig file that follows from it."""

    kind: str
    found: Found
    rig_text: str


def read_mean(backend: Backend, config: RigConfig) -> float:
    """Return the mean electrical reading of the force channel while nothing moves."""
    raw: list[Array] = []
    rates: list[float] = []

    def take(block: Block, rate_hz: float) -> bool:
        raw.append(block.force_raw)
        rates.append(rate_hz)
        return False

    read_quiet(backend, config, config.recording.block_s, SETTLE_S + READ_S, take)
    n = int(round(int(READ_S * config.mains_frequency_hz) / config.mains_frequency_hz * rates[0]))
    return float(np.concatenate(raw)[-n:].mean())


def dead_weights(
    rig: Rig, backend: Backend, masses_kg: Sequence[float], ask: Ask, *, u_mass_kg: float, gravity: float | None
) -> Calibration:
    """Calibrate the load cell with dead weights, up and down; the line through them replaces the rig file's.

    Parameters
    ----------
    masses_kg : masses above 0, rising; zero is read before, between and after
    u_mass_kg : standard uncertainty of a mass, kg
    gravity : local acceleration, m/s^2, known to 1e-4; None takes the standard value with an uncertainty of 0.015
    """
    force = rig.config.force
    g, u_g = (STANDARD_GRAVITY, U_GRAVITY) if gravity is None else (gravity, U_LOCAL_GRAVITY * gravity)
    masses = list(masses_kg)
    if len(masses) < 2 or masses != sorted(set(masses)) or masses[0] <= 0:
        raise RigInputError(f"weights {masses} kg: allowed from two, above 0, each once, rising")
    if masses[-1] * g > force.max_n:
        raise RigInputError(
            f"weight {masses[-1]:g} kg is {masses[-1] * g:.4g} N, allowed {force.max_n:g} N (force.max_n)"
        )
    steps = [0.0, *masses, *masses[-2::-1], 0.0]
    readings = []
    for mass in steps:
        ask(f"put {mass:g} kg on the load cell" if mass else "take everything off the load cell", mass)
        readings.append(read_mean(backend, rig.config))
    fit = fit_line([mass * g for mass in steps], readings, force.channel)
    relative = float(np.sqrt((fit.u_slope / fit.slope) ** 2 + (u_g / g) ** 2 + (u_mass_kg / masses[-1]) ** 2))
    full_n = float(max(force.physical_n, key=abs))
    before = (force.electrical[1] - force.electrical[0]) / (force.physical_n[1] - force.physical_n[0])
    values: dict[str, Value] = {
        "electrical": (fit.zero, fit.zero + fit.slope * full_n),
        "physical_n": (0.0, full_n),
        "u_gain_relative": relative,
        "calibration": f"dead weights, {len(masses)} up to {masses[-1]:g} kg",
    }
    if force.offset_n is not None:
        values["offset_n"] = 0.0  # the line goes through the unloaded reading
    found: Found = {
        "masses_kg": steps,
        "readings": readings,
        "unit": force.electrical_unit,
        "gravity_m_per_s2": g,
        "u_gravity_m_per_s2": u_g,
        "u_mass_kg": u_mass_kg,
        "zero": fit.zero,
        "u_zero": fit.u_zero,
        "slope_per_n": fit.slope,
        "u_slope_relative": relative,
        "gain_against_rig_file": fit.slope / before,
        "zero_n": fit.zero / fit.slope,
        "nonlinearity_n": fit.worst / abs(fit.slope),
        "hysteresis_n": fit.hysteresis / abs(fit.slope),
    }
    return _finish_calibration("weights", found, rig, values)


def shunt(rig: Rig, backend: SelftestBackend) -> Calibration:
    """Switch the module's shunt resistor in and correct the gain by what it should and does change."""
    force, selftest = rig.config.force, rig.config.selftest
    if force.kind != "bridge" or selftest is None or selftest.shunt_ohm == 0:
        raise RigInputError(f"{rig.source}: has no bridge with a shunt resistor (force.kind, selftest.shunt_ohm)")
    wanted = 1e3 * force.bridge_resistance_ohm / (4 * selftest.shunt_ohm + 2 * force.bridge_resistance_ohm)
    steps = [backend.shunt_step(rig.config) for _ in range(SHUNT_STEPS)]
    mean, u_mean = float(np.mean(steps)), float(np.std(steps, ddof=1) / np.sqrt(len(steps)))
    gain = mean / wanted
    if abs(gain - 1) > LARGEST_CORRECTION:
        raise RigInputError(
            f"{force.channel}: the shunt changes the reading by {mean:.4f} mV/V, expected {wanted:.4f}; look at the "
            "wiring, excitation and bridge_resistance_ohm before calibrating"
        )
    zero, full = force.electrical
    values: dict[str, Value] = {
        "electrical": (zero, zero + (full - zero) * gain),
        "calibration": f"{force.calibration}; shunt {selftest.shunt_ohm:g} ohm, gain {gain:.6f}",
    }
    if force.offset_n is not None:
        values["offset_n"] = force.physical_n[0] + (force.offset_n - force.physical_n[0]) / gain
    found: Found = {
        "steps_mv_per_v": steps,
        "expected_mv_per_v": wanted,
        "gain": gain,
        "u_gain": u_mean / wanted,
    }
    return _finish_calibration("shunt", found, rig, values)


def null(rig: Rig, backend: Backend, ask: Ask) -> Calibration:
    """Read the unloaded bridge; the rig file's line is shifted so that it reads 0 N."""
    ask("lift the arm off the key; nothing touches the load cell", 0.0)
    reading = read_mean(backend, rig.config)
    force = rig.config.force
    slope = (force.electrical[1] - force.electrical[0]) / (force.physical_n[1] - force.physical_n[0])
    at_zero = force.electrical[0] - slope * force.physical_n[0]
    shift = reading - at_zero
    values: dict[str, Value] = {
        "electrical": (force.electrical[0] + shift, force.electrical[1] + shift),
        "calibration": f"{force.calibration}; nulled by {shift / slope:+.4g} N",
        "offset_n": 0.0,
    }
    found: Found = {
        "reading": reading,
        "unit": force.electrical_unit,
        "shift_n": shift / slope,
    }
    return _finish_calibration("null", found, rig, values)


def _finish_calibration(kind: str, found: Found, rig: Rig, values: dict[str, Value]) -> Calibration:
    dated = f"{values['calibration']}, {datetime.now(UTC):%Y-%m-%d}"
    return Calibration(kind, found, rewritten(rig, "force", values | {"calibration": dated}))


HELD_S = 0.8  # at least, at a reference angle: 40 periods of 50 Hz
STILL_COUNTS = 3  # within which an encoder counts as at rest
APART = 0.3  # of the smallest step, by which two angles must differ to be two: choice below a half
LONGEST_ARC_S = 1800.0  # half an hour for all angles by hand
CONTRADICTS = 3.0  # standard uncertainties between references and rig file, from which the references replace it


@dataclass(frozen=True)
class Arc:
    """True angle over reading, its standard uncertainty, and the largest distance of a reading from the line, rad."""

    gain: float
    u_gain: float
    worst_rad: float
    readings_rad: tuple[float, ...]
    references_rad: tuple[float, ...]


def up_and_down(angles_rad: ArrayLike) -> tuple[float, ...]:
    up = tuple(as_numbers(angles_rad, "reference angles", 1).tolist())
    if len(up) < 3 or list(up) != sorted(set(up)) or not np.all(np.isfinite(up)):
        raise RigInputError(f"reference angles {list(up)} rad: allowed from three, each once, rising")
    return up + up[-2::-1]


def read_plateaus(backend: Backend, config: RigConfig, body: str, references: Sequence[float]) -> list[float]:
    """Return the mean readings, rad, at as many rests as there are references, in the order they came."""
    index = BODIES.index(body)
    encoder = config.encoders[index]
    apart = APART * float(np.min(np.abs(np.diff(references)))) / abs(encoder.rad_per_count)
    recent: NDArray[np.int64] = np.empty(0, dtype=np.int64)
    found: list[float] = []

    def take(block: Block, rate_hz: float) -> bool:
        nonlocal recent
        held = int(HELD_S * rate_hz)
        recent = np.concatenate((recent, block.encoder_count[:, index]))[-held:]
        still = recent.size == held and np.ptp(recent) <= STILL_COUNTS
        if still and (not found or abs(float(recent.mean()) - found[-1]) > apart):
            found.append(float(recent.mean()))
        return len(found) == len(references)

    read_quiet(backend, config, CALM_BLOCK_S, LONGEST_ARC_S, take)
    if len(found) < len(references):
        raise RigInputError(
            f"{encoder.counter}: {len(found)} rests of {HELD_S:g} s seen, expected {len(references)}; hold each angle "
            "longer, and go up and down again"
        )
    return [value * encoder.rad_per_count for value in found]


def fit_arc(references: Sequence[float], readings: Sequence[float], u_angle_rad: float, encoder: EncoderConfig) -> Arc:
    """Fit readings over references; up and down together, so that play of the references is in the uncertainty.

    Readings that happen to scatter less than counts are rounded are known no better than a count / sqrt 12.
    """
    x = np.asarray(references, dtype=float)
    fit = fit_line(x, readings, encoder.counter)
    gain = 1.0 / fit.slope
    if abs(gain - 1.0) > LARGEST_CORRECTION:
        raise RigInputError(
            f"{encoder.counter}: reads {fit.slope:.4f} of the reference angles, allowed 1 within "
            f"{LARGEST_CORRECTION:.0%}; look at counts_per_revolution, the sign, and the sense of the angles"
        )
    spread = float(np.sqrt(np.sum((x - x.mean()) ** 2)))
    u_slope = max(fit.u_slope, abs(encoder.rad_per_count) / 12**0.5 / spread)
    # a reference is off alike on the way up and down
    pulls = [np.sum(x[x == value] - x.mean()) / spread**2 for value in np.unique(x)]
    u = float(np.hypot(u_slope, u_angle_rad * np.linalg.norm(pulls))) * gain**2
    return Arc(gain, u, fit.worst, tuple(float(r) for r in readings), tuple(x.tolist()))


def with_what_was_known(rig: Rig, body: str, arc: Arc) -> tuple[float, float]:
    """Return correction and uncertainty from the readings and the rig file together.

    The mean weighted by uncertainty, so that coarse references spoil no scale that is known better; readings that
    contradict the rig file by three standard uncertainties replace it.
    """
    encoder = rig.config.encoders[BODIES.index(body)]
    known, u_known = encoder.arc_gain, encoder.u_eccentricity_rad
    if abs(arc.gain - known) > CONTRADICTS * np.hypot(arc.u_gain, u_known):
        return arc.gain, arc.u_gain
    if (known, u_known) == (1.0, 0.0):  # nothing was stated
        return arc.gain, arc.u_gain
    if u_known == 0.0 or arc.u_gain == 0.0:
        return (known, u_known) if u_known == 0.0 else (arc.gain, arc.u_gain)
    weights = np.array([arc.u_gain, u_known]) ** -2.0
    return float(weights @ [arc.gain, known] / weights.sum()), float(weights.sum() ** -0.5)


def corrected_rig(rig: Rig, body: str, arc: Arc) -> str:
    """Return the rig file's text with the correction of one encoder and its uncertainty."""
    gain, u_gain = with_what_was_known(rig, body, arc)
    values = {"arc_gain": float(f"{gain:.9g}"), "u_eccentricity_rad": float(f"{u_gain:.3g}")}
    return rewritten(rig, "encoders", values, named=body)


LONGEST_SWING_S = 60.0  # from the lift to rest; a swing that takes longer was not let go
STILL_S = 0.5  # within two counts: the swing has ended
SMOOTHED_S = 0.012  # length of the local parabola that gives the speed: what it flattens is in the uncertainty
LEAST_TURN_RAD = 0.1  # of a half swing that counts: 50 counts of a usual scale and more
MOVING_SHARE = 0.2  # of a half swing's largest speed, above which the sign of its friction is sure
FITTED_SAMPLES = 200  # of a half swing at most: more of them are not independent
FEWEST_SWINGS = 3  # half swings, so that their scatter is known


@dataclass(frozen=True)
class Swing:
    """What the swings of a body say."""

    # share, u_share: friction torque over weight times arm, and its standard uncertainty
    share: float
    u_share: float
    frequency_hz: float  # of small swings without friction
    half_swings: int  # how many counted
    top_rad_per_s: float = 0.0  # largest speed


def read_swing(backend: Backend, config: RigConfig, body: str) -> tuple[Array, float]:
    """Return the angle of a body, rad, from before it is let go until it has rested, and the sample rate, Hz."""
    index = BODIES.index(body)
    encoder = config.encoders[index]
    counts: list[NDArray[np.int64]] = []
    swung, rate = False, 0.0

    def take(block: Block, rate_hz: float) -> bool:
        nonlocal swung, rate
        rate = rate_hz
        counts.append(block.encoder_count[:, index])
        size = counts[0].size
        recent = np.concatenate(counts[-int(STILL_S * rate_hz / size) - 1 :])
        swung = swung or float(np.ptp(recent)) * abs(encoder.rad_per_count) > LEAST_TURN_RAD
        return bool(swung and len(counts) * size > STILL_S * rate_hz and np.ptp(recent) <= 2)

    read_quiet(backend, config, config.recording.block_s, LONGEST_SWING_S, take)
    angle: Array = np.concatenate(counts).astype(np.float64) * encoder.rad_per_count
    if not swung:
        raise RigInputError(
            f"{encoder.counter}: the {body} did not swing within {LONGEST_SWING_S:g} s; lift it and let it go"
        )
    return angle, rate


def friction_of_swing(angle_rad: Array, rate_hz: float, body: str) -> Swing:
    """Find the friction of a joint from the angle of its freely swinging body, (n,)."""
    half = max(int(SMOOTHED_S * rate_hz / 2), 2)
    k = np.arange(-half, half + 1)
    speed = np.convolve(angle_rad, -k / (k @ k) * rate_hz, mode="valid")
    smooth = np.convolve(angle_rad, np.full(k.size, 1.0 / k.size), mode="valid")
    spans = _half_swings(smooth, speed)
    if len(spans) < FEWEST_SWINGS:
        raise RigInputError(
            f"{body}: {len(spans)} half swings of {LEAST_TURN_RAD:g} rad or more, allowed from {FEWEST_SWINGS}; let it "
            "go from higher up, or hang a weight of known moment on it"
        )
    share, omega2 = _fit(smooth, speed, spans)
    each = np.array([_fit(smooth, speed, spans[:i] + spans[i + 1 :])[0] for i in range(len(spans))])
    n = len(spans)
    jackknife = float(np.sqrt((n - 1) / n * np.sum((each - each.mean()) ** 2)))
    if share <= 0 or omega2 <= 0:
        raise RigInputError(f"{body}: gains energy as it swings ({share:.3g}); look for a push, or the encoder's sign")
    frequency = float(np.sqrt(omega2) / (2 * np.pi))
    # the parabola takes this share off a speed that changes within it
    flattened = share * (2 * np.pi * frequency * half / rate_hz) ** 2 / 10  # slope of a line through a sine
    return Swing(share, float(np.hypot(jackknife, flattened)), frequency, n, float(np.abs(speed).max()))


def _half_swings(angle: Array, speed: Array) -> list[tuple[int, int]]:
    """Spans between turning points in which the body goes far enough; the first begins where it was let go."""
    turns = np.flatnonzero(np.diff(np.signbit(speed).astype(int)) != 0) + 1
    edges = np.concatenate(([0], turns, [speed.size]))
    spans = []
    for first, end in zip(edges[:-1], edges[1:], strict=True):
        moving = np.flatnonzero(np.abs(speed[first:end]) > MOVING_SHARE * np.abs(speed[first:end]).max(initial=0.0))
        if moving.size and abs(angle[end - 1] - angle[first]) > LEAST_TURN_RAD:
            spans.append((int(first + moving[0]), int(first + moving[-1])))
    return spans


def _fit(angle: Array, speed: Array, spans: list[tuple[int, int]]) -> tuple[float, float]:
    """Friction over weight times arm, and the square of the small swings' angular frequency."""
    rows, energy = [], []
    for number, (first, end) in enumerate(spans):
        step = max((end - first) // FITTED_SAMPLES, 1)
        a, v = angle[first:end:step], speed[first:end:step]
        offsets = np.zeros((a.size, len(spans)))
        offsets[:, number] = 1.0
        rows.append(np.column_stack([np.cos(a), np.sin(a), -np.sign(v) * a, offsets]))
        energy.append(0.5 * v * v)
    found, *_ = np.linalg.lstsq(np.concatenate(rows), np.concatenate(energy), rcond=None)
    omega2 = float(np.hypot(found[0], found[1]))
    return float(found[2]) / omega2, omega2
