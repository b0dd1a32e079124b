"""The guided calibrations: what the operator is asked, what is read, what follows from it.

The motor is off throughout: 0 V, drive disabled, no motor task. Readings are means over whole periods of the mains.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime

import numpy as np

from rig.backend import Backend
from rig.calibration.line_fit import fit_line
from rig.calibration.rig_text import Value, changed
from rig.configuration.rig_file import Rig, RigConfig, parse_rig
from rig.errors import RigInputError
from rig.selftest.backend import SelftestBackend

READ_S = 2.0
SETTLE_S = 0.3
READ_TIMEOUT_S = 5.0
STANDARD_GRAVITY, U_GRAVITY = 9.80665, 0.015
"""m/s^2; from the equator to the poles it differs by less than 0.03."""
Ask = Callable[[str, float], None]
"""Shows an instruction, with the mass that is to hang on the cell, kg, and returns when it is done."""


@dataclass(frozen=True)
class Calibration:
    """One calibration: what was found, by name; the rig file that follows from it."""

    kind: str
    created_utc: datetime
    found: dict[str, float | str | list[float]] = field(default_factory=dict)
    rig_text: str = ""


def read_mean(backend: Backend, config: RigConfig) -> float:
    """Return the mean electrical reading of the force channel while nothing moves."""
    quiet = config.model_copy(update={"camera": None, "watchdog": None})
    timing = backend.configure(quiet, None)
    try:
        backend.arm(enable_drive=False)
        backend.start()
        rate = timing.sample_rate_hz
        size = max(int(config.recording.block_s * rate), 1)
        blocks = [backend.read_block(size, READ_TIMEOUT_S) for _ in range(int((SETTLE_S + READ_S) * rate) // size)]
    finally:
        backend.safe_stop()
    n = int(round(int(READ_S * config.mains_frequency_hz) / config.mains_frequency_hz * rate))
    return float(np.concatenate([block.force_raw for block in blocks])[-n:].mean())


def dead_weights(
    rig: Rig, backend: Backend, masses_kg: Sequence[float], ask: Ask, *, u_mass_kg: float, gravity: float | None
) -> Calibration:
    """Calibrate the load cell with dead weights, up and down; the line through them replaces the rig file's.

    Parameters
    ----------
    masses_kg : sequence of float
        Masses above 0, rising; zero is read before, between and after.
    u_mass_kg : float
        Standard uncertainty of a mass, kg.
    gravity : float or None
        Local acceleration, m/s^2, known to 1e-4; None takes the standard value with an uncertainty of 0.015.

    Raises
    ------
    RigInputError
        Masses that are not rising, beyond the range of the channel, or readings that do not follow them.
    HardwareFault
        As when recording.
    """
    force = rig.config.force
    g, u_g = (STANDARD_GRAVITY, U_GRAVITY) if gravity is None else (gravity, 1e-4 * gravity)
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
    today = datetime.now(UTC)
    before = (force.electrical[1] - force.electrical[0]) / (force.physical_n[1] - force.physical_n[0])
    values: dict[str, Value] = {
        "electrical": (fit.zero, fit.zero + fit.slope * full_n),
        "physical_n": (0.0, full_n),
        "u_gain_relative": relative,
        "calibration": f"dead weights, {len(masses)} up to {masses[-1]:g} kg, {today:%Y-%m-%d}",
    }
    found: dict[str, float | str | list[float]] = {
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
    return _done("weights", today, found, rig, values)


def shunt(rig: Rig, backend: SelftestBackend) -> Calibration:
    """Switch the module's shunt resistor in and correct the gain by what it should and does change.

    Raises
    ------
    RigInputError
        Without a bridge, without a shunt resistor in ``[selftest]``, or where the change is off by more than a tenth.
    """
    force, selftest = rig.config.force, rig.config.selftest
    if force.kind != "bridge" or selftest is None or selftest.shunt_ohm == 0:
        raise RigInputError(f"{rig.source}: has no bridge with a shunt resistor (force.kind, selftest.shunt_ohm)")
    wanted = 1e3 * force.bridge_resistance_ohm / (4 * selftest.shunt_ohm + 2 * force.bridge_resistance_ohm)
    steps = [backend.shunt_step(rig.config) for _ in range(5)]
    mean, u_mean = float(np.mean(steps)), float(np.std(steps, ddof=1) / np.sqrt(len(steps)))
    gain = mean / wanted
    if abs(gain - 1) > 0.1:
        raise RigInputError(
            f"{force.channel}: the shunt changes the reading by {mean:.4f} mV/V, expected {wanted:.4f}; look at the "
            "wiring, excitation and bridge_resistance_ohm before calibrating"
        )
    zero, full = force.electrical
    today = datetime.now(UTC)
    values: dict[str, Value] = {
        "electrical": (zero, zero + (full - zero) * gain),
        "calibration": f"{force.calibration}; shunt {selftest.shunt_ohm:g} ohm, gain {gain:.6f}, {today:%Y-%m-%d}",
    }
    found: dict[str, float | str | list[float]] = {
        "steps_mv_per_v": steps,
        "expected_mv_per_v": wanted,
        "gain": gain,
        "u_gain": u_mean / wanted,
    }
    return _done("shunt", today, found, rig, values)


def null(rig: Rig, backend: Backend, ask: Ask) -> Calibration:
    """Read the unloaded bridge; the rig file's line is shifted so that it reads 0 N."""
    ask("lift the arm off the key; nothing touches the load cell", 0.0)
    reading = read_mean(backend, rig.config)
    force = rig.config.force
    slope = (force.electrical[1] - force.electrical[0]) / (force.physical_n[1] - force.physical_n[0])
    at_zero = force.electrical[0] - slope * force.physical_n[0]
    shift = reading - at_zero
    today = datetime.now(UTC)
    values: dict[str, Value] = {
        "electrical": (force.electrical[0] + shift, force.electrical[1] + shift),
        "calibration": f"{force.calibration}; nulled by {shift / slope:+.4g} N, {today:%Y-%m-%d}",
        "offset_n": 0.0,
    }
    found: dict[str, float | str | list[float]] = {
        "reading": reading,
        "unit": force.electrical_unit,
        "shift_n": shift / slope,
    }
    return _done("null", today, found, rig, values)


def _done(
    kind: str,
    today: datetime,
    found: dict[str, float | str | list[float]],
    rig: Rig,
    values: dict[str, Value],
) -> Calibration:
    text = changed(rig.text, "force", values)
    parse_rig(text, f"{rig.source} as calibrated")  # it must be a rig file still
    return Calibration(kind, today, found, text)
