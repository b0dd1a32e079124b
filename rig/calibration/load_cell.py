"""Calibration of the load cell on the bench, the motor off: dead weights, shunt resistor, unloaded reading."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime

import numpy as np
from numpy.typing import NDArray

from rig.backend import Backend, Block
from rig.calibration.line_fit import LARGEST_CORRECTION, fit_line
from rig.calibration.quiet_reading import read_quiet
from rig.configuration.rig_file import Rig, RigConfig
from rig.configuration.rig_file_edit import Value, rewrite_table
from rig.errors import RigInputError
from rig.selftest import SelftestBackend

Array = NDArray[np.float64]
READ_S = 2.0  # of a mean, cut to whole mains periods
SETTLE_S = 0.3  # left out after the operator says the mass hangs
STANDARD_GRAVITY, U_GRAVITY = 9.80665, 0.015  # m/s^2; from equator to poles it differs by less than 0.03
U_LOCAL_GRAVITY = 1e-4  # of a stated local one, relative: a hundred metres of height change a third of it
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
    """Return the mean electrical reading of the force channel over two seconds in which nothing moves, mV/V or V."""
    raw: list[Array] = []
    rates: list[float] = []

    def take(block: Block, rate_hz: float) -> bool:
        raw.append(block.force_raw)
        rates.append(rate_hz)
        return False

    read_quiet(backend, config, config.recording.block_s, SETTLE_S + READ_S, take)
    n = int(round(int(READ_S * config.mains_frequency_hz) / config.mains_frequency_hz * rates[0]))
    return float(np.concatenate(raw)[-n:].mean())


def calibrate_with_weights(
    rig: Rig, backend: Backend, masses_kg: Sequence[float], ask: Ask, *, u_mass_kg: float, gravity: float | None
) -> Calibration:
    """Fit the load cell's line as the operator, told by ``ask``, puts rising masses on and takes them off;
    ``u_mass_kg``: standard uncertainty of a mass, ``gravity``: m/s², None for the standard. Return figures and a new
    rig file's text."""
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


def calibrate_with_shunt(rig: Rig, backend: SelftestBackend) -> Calibration:
    """Switch the bridge module's shunt resistor in five times and correct the gain by the change found over that
    expected; return figures and a new rig file's text. Refuse a rig without one, and a gain more than 10 % off 1."""
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
    found: Found = {"steps_mv_per_v": steps, "expected_mv_per_v": wanted, "gain": gain, "u_gain": u_mean / wanted}
    return _finish_calibration("shunt", found, rig, values)


def calibrate_zero(rig: Rig, backend: Backend, ask: Ask) -> Calibration:
    """Let the operator, told by ``ask``, unload the cell, read it, and shift the rig file's line so that it then reads
    0 N; return reading, shift in N, and the new rig file's text. Nothing is written."""
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
    found: Found = {"reading": reading, "unit": force.electrical_unit, "shift_n": shift / slope}
    return _finish_calibration("null", found, rig, values)


def _finish_calibration(kind: str, found: Found, rig: Rig, values: dict[str, Value]) -> Calibration:
    dated = f"{values['calibration']}, {datetime.now(UTC):%Y-%m-%d}"
    return Calibration(kind, found, rewrite_table(rig, "force", values | {"calibration": dated}))
