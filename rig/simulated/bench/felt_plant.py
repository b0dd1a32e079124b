"""A felt of the specimen alone, or a block of steel, under the motor arm.

It is pressed by rotor, arm and load cell. The scale is on the motor's shaft, the cell at the arm's tip; between them
gives way what the specimen's ``motor_arm`` says of load cell and adhesive strip. The felt follows eqs 2.4 and 2.5, as
in the specimen's contact: force of the cubic times one plus D times the rate of compression, never below zero. Rotor
and arm are stepped explicitly, the two springs in series implicitly, some ten times as fast as the arm rings.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

import model
from model.parameters.action import USUAL
from rig.configuration.rig_file import RigConfig
from rig.errors import RigInputError
from rig.simulated.bench.plant import ActionPlant
from rig.simulated.bench.plant_protocol import ENCODED_BODIES, PlantBlock

Array = NDArray[np.float64]
BLOCK = "block"
BLOCK_N_PER_M = 1e9  # steel: 2e11 Pa, 1 cm^2 over 20 mm
STEP_S = 1e-4  # of the integration: half a sample interval at 5 kHz
BALANCED_N = 1e-9  # N: residual at which the force balance counts as met
STILL_M_PER_S = 1e-9  # m/s: as good as rest
SLIP_M_PER_S = 1e-4  # over which the friction of the shaft changes its sign: choice, below any press
ARM = (
    *("inertia", "length", "joint_friction", "spring_stiffness", "preload_n"),
    *("contact_a", "contact_b", "contact_c", "contact_damping"),
)


@dataclass(frozen=True)
class FeltLaw:
    """Eqs 2.4 and 2.5: a, N/m^3, b, N/m^2, c, N/m, and D, s/m."""

    a: float
    b: float
    c: float
    d: float

    def force_n(self, x_m: float, rate_m_per_s: float) -> float:
        return self.force_and_slope(x_m, rate_m_per_s, math.inf)[0]

    def force_and_slope(self, x_m: float, rate_m_per_s: float, h: float) -> tuple[float, float]:
        """Force, and its derivative by a compression that is reached within ``h`` seconds."""
        fit = ((self.a * x_m + self.b) * x_m + self.c) * x_m
        factor = 1.0 + self.d * rate_m_per_s
        if x_m <= 0.0 or fit <= 0.0 or factor <= 0.0:
            return 0.0, 0.0
        return fit * factor, ((3.0 * self.a * x_m + 2.0 * self.b) * x_m + self.c) * factor + fit * self.d / h


@dataclass(frozen=True)
class FeltTruth:
    """What really happened in a press: time, compression, force of the felt, way of the arm's tip at the shaft."""

    time_s: Array
    compression_m: Array
    force_n: Array
    moved_m: Array
    law: FeltLaw


def felt_law(action: model.Action, contact: str) -> FeltLaw:
    """Felt law of a ``contact`` of the specimen (``contact01`` to ``contact13``) pressed alone, or of the steel
    ``block``; refuse another name, and a contact whose force law is not the usual one of eqs 2.4 and 2.5."""
    if contact == BLOCK:
        return FeltLaw(0.0, 0.0, BLOCK_N_PER_M, 0.0)
    if f"{contact}.normal.a" not in action.quantities:
        raise RigInputError(f"felt {contact}: not found; allowed contact01 to contact13, or {BLOCK}")
    if (law := action.law(contact)) != USUAL:
        raise RigInputError(f"felt {contact}: follows the law {law}, allowed {USUAL}, the only one pressed alone")
    return FeltLaw(*(action[f"{contact}.normal.{name}"] for name in "abcD"))


class FeltPlant:
    """The arm on a felt; implements `rig.simulated.bench.plant_protocol.Plant`.

    Parameters
    ----------
    arm : ``motor_arm`` of the specimen, the values named in ``ARM``
    torque_per_volt_nm, gain_scatter, seed
        Of the motor, and its scatter from trial to trial.
    body : which encoder's scale is on the shaft
    """

    def __init__(
        self,
        law: FeltLaw,
        arm: Mapping[str, float],
        torque_per_volt_nm: float,
        gain_scatter: float,
        seed: int,
        body: int,
        sample_rate_hz: float,
    ) -> None:
        self.sample_rate_hz = sample_rate_hz
        self.law, self._arm, self._body = law, dict(arm), body
        self._cell = FeltLaw(*(arm[f"contact_{name}"] for name in ("a", "b", "c", "damping")))
        self._n_per_volt, self._scatter, self._seed = torque_per_volt_nm / arm["length"], gain_scatter, seed
        length = arm["length"]
        self._mass, self._spring = arm["inertia"] / length**2, arm["spring_stiffness"] / length**2
        self._friction, self._preload = arm["joint_friction"] / length, arm["preload_n"]
        self.start_trial(1)

    def start_trial(self, trial: int) -> None:
        """Put the arm at rest on the felt, under its preload, draw the motor's scatter from the seed and the trial's
        number, and forget the record of the trial before."""
        random = np.random.default_rng([self._seed, trial])
        self._per_volt = self._n_per_volt * (1.0 + self._scatter * float(np.clip(random.standard_normal(), -3.0, 3.0)))
        preload = self._preload
        self._x = _compression(self.law, preload)
        self._moved = self._x + _compression(self._cell, preload)
        self._rest = self._moved
        self._speed, self._force, self._edge = 0.0, preload, 0
        self._record: list[tuple[Array, ...]] = []

    def advance(self, command_v: Array) -> PlantBlock:
        """Hold each motor voltage of ``command_v`` (n,) for one sample period; return the state at the n edges at which
        they begin, before they have acted."""
        period = 1.0 / self.sample_rate_hz
        steps = max(int(math.ceil(period / STEP_S - 1e-9)), 1)
        rows = np.empty((len(command_v), 3))
        for k, volts in enumerate(np.asarray(command_v, dtype=float).tolist()):
            rows[k] = self._x, self._force, self._moved
            if volts == 0.0 and abs(self._speed) < STILL_M_PER_S and abs(self._net_n(0.0)) < BALANCED_N:
                continue
            for _ in range(steps):
                self._step(self._per_volt * volts, period / steps)
        time_s = (self._edge + np.arange(len(command_v))) / self.sample_rate_hz
        self._edge += len(command_v)
        self._record.append((time_s, rows))
        angle = -(rows[:, 2] - self._rest) / self._arm["length"]
        seen = np.zeros((len(command_v), len(ENCODED_BODIES)))
        seen[:, self._body] = angle
        return PlantBlock(time_s=time_s, force_n=rows[:, 1].copy(), angle_rad=seen, motor_rad=angle)

    def truth(self) -> FeltTruth:
        time_s, rows = (np.concatenate(parts) for parts in zip(*self._record, strict=True))
        return FeltTruth(time_s, rows[:, 0], rows[:, 1], rows[:, 2], self.law)

    def _step(self, pushed_n: float, h: float) -> None:
        self._speed += h * self._net_n(pushed_n) / self._mass
        before = self._moved - self._x
        self._moved += h * self._speed
        self._x = self._balance(before, h)
        self._force = self._cell.force_n(self._moved - self._x, (self._moved - self._x - before) / h)

    def _net_n(self, pushed_n: float) -> float:
        spring = self._spring * (self._moved - self._rest)
        friction = self._friction * math.tanh(self._speed / SLIP_M_PER_S)
        return pushed_n + self._preload - spring - friction - self._force

    def _balance(self, before: float, h: float) -> float:
        """Compression of the felt, m, at which it and the load cell in series press with the same force at the end of a
        step of ``h`` s, the arm's way being known; ``before``: compression of the cell at the step's beginning, m."""
        low, high = min(0.0, self._moved), max(self._moved, 0.0)
        if self._excess(high, before, h)[0] <= 0.0:
            return high  # apart, or just touching
        x = min(max(self._x, low), high)
        for _ in range(60):  # Newton's method within a bracket
            excess, slope = self._excess(x, before, h)
            if abs(excess) < BALANCED_N:
                break
            low, high = (low, x) if excess > 0.0 else (x, high)
            x -= excess / slope if slope > 0.0 else 0.0
            if not low < x < high:
                x = 0.5 * (low + high)
        return x

    def _excess(self, x: float, before: float, h: float) -> tuple[float, float]:
        """Force of the felt minus that of the cell at a compression, and its slope."""
        felt, felt_slope = self.law.force_and_slope(x, (x - self._x) / h, h)
        y = self._moved - x
        cell, cell_slope = self._cell.force_and_slope(y, (y - before) / h, h)
        return felt - cell, felt_slope + cell_slope


def make_felt_plant(bench: ActionPlant, contact: str, config: RigConfig) -> FeltPlant:
    """Plant of the bench's motor arm on the felt of ``contact`` of its specimen, or on the steel ``block``, in place of
    the key; refuse a rig file without ``[felt]``, which names the encoder on the motor's shaft."""
    if config.felt is None:
        raise RigInputError(f"rig {config.name}: has no table [felt], which says which encoder is on the motor's shaft")
    arm = {name: bench.action[f"motor_arm.{name}"] for name in ARM}
    body = ENCODED_BODIES.index(config.felt.encoder)
    scatter = bench.scatter.get("motor_gain", 0.0)
    law = felt_law(bench.action, contact)
    return FeltPlant(law, arm, bench.torque_per_volt_nm, scatter, bench.seed, body, bench.sample_rate_hz)


def _compression(law: FeltLaw, force_n: float) -> float:
    """Compression under a constant force, m: where the cubic reaches it first."""
    x = np.roots([law.a, law.b, law.c, -force_n])
    return float(x.real[(np.abs(x.imag) <= 1e-9 * np.abs(x)) & (x.real >= 0.0)].min())
