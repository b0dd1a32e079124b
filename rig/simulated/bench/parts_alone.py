"""Parts of the specimen alone: a felt, or a block of steel, under the motor arm; one body on its joint.

The felt is pressed by rotor, arm and load cell. The scale is on the motor's shaft, the cell at the arm's tip; between
them gives way what the specimen's ``motor_arm`` says of load cell and adhesive strip. The felt follows eqs 2.4 and 2.5,
as in the specimen's contact: force of the cubic times one plus D times the rate of compression, never below zero. Rotor
and arm are stepped explicitly, the two springs in series implicitly, some ten times as fast as the arm rings.

The body is held at reference angles one after the other, or swings freely. Held as in ``pianorig calibrate encoder``;
held up, let go, until friction holds it, as in ``calibrate joint``: the law of the joint is the specimen's, dry
friction with its smoothed sign. With a pad, as in ``calibrate contact``, a pair of a contact's materials rubs on a drum
about the axis, by eq. 2.10.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

import model
from model.parameters.action import USUAL
from rig.configuration.rig_file import RigConfig
from rig.errors import RigInputError
from rig.simulated.bench.plant import ActionPlant
from rig.simulated.bench.plant_protocol import ENCODED_BODIES, PlantBlock

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
Array = NDArray[np.float64]


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
    """Felt law of a contact, or of the steel block, as pressed without the action."""
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
        """Put the arm at rest on the felt, under its preload, and draw the motor's scatter."""
        random = np.random.default_rng([self._seed, trial])
        self._per_volt = self._n_per_volt * (1.0 + self._scatter * float(np.clip(random.standard_normal(), -3.0, 3.0)))
        preload = self._preload
        self._x = _compression(self.law, preload)
        self._moved = self._x + _compression(self._cell, preload)
        self._rest = self._moved
        self._speed, self._force, self._edge = 0.0, preload, 0
        self._record: list[tuple[Array, ...]] = []

    def advance(self, command_v: Array) -> PlantBlock:
        """Apply each of the (n,) volts for one sample period; return the state at the n edges before them."""
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
        """Everything since the trial started."""
        time_s, rows = (np.concatenate(parts) for parts in zip(*self._record, strict=True))
        return FeltTruth(time_s, rows[:, 0], rows[:, 1], rows[:, 2], self.law)

    def _step(self, pushed_n: float, h: float) -> None:
        self._speed += h * self._net_n(pushed_n) / self._mass
        before = self._moved - self._x
        self._moved += h * self._speed
        self._x = self._balance(before, h)
        self._force = self._cell.force_n(self._moved - self._x, (self._moved - self._x - before) / h)

    def _net_n(self, pushed_n: float) -> float:
        """Force that accelerates the arm, at its tip."""
        spring = self._spring * (self._moved - self._rest)
        friction = self._friction * math.tanh(self._speed / SLIP_M_PER_S)
        return pushed_n + self._preload - spring - friction - self._force

    def _balance(self, before: float, h: float) -> float:
        """Compression, m, at which felt and cell press alike ``h`` s later; ``before`` is the cell's now."""
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
    """Return the arm of a bench on the felt of its specimen's ``contact`` in place of the key."""
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


HELD_S, MOVED_S = 1.2, 0.3  # at a reference angle, and on the way to the next: a careful hand


class PosePlant:
    """One body at given angles from rest; implements `rig.simulated.bench.plant_protocol.Plant`."""

    def __init__(self, rest_rad: NDArray[np.float64], body: str, angles_rad: Sequence[float], rate_hz: float) -> None:
        self.sample_rate_hz = rate_hz
        self._rest, self._body = rest_rad, ENCODED_BODIES.index(body)
        begins = np.arange(len(angles_rad)) * (HELD_S + MOVED_S)
        self._time_s = np.column_stack((begins, begins + HELD_S)).ravel()
        self._angle = np.repeat(np.asarray(angles_rad, dtype=float), 2)
        self._edge = 0

    def start_trial(self, trial: int) -> None:
        self._edge = 0

    def advance(self, command_v: NDArray[np.float64]) -> PlantBlock:
        """Hold, move on, hold; the motor has nothing to do with it."""
        n = len(command_v)
        time_s = np.arange(self._edge, self._edge + n, dtype=np.float64) / self.sample_rate_hz
        self._edge += n
        seen = np.tile(self._rest, (n, 1))
        seen[:, self._body] += np.interp(time_s, self._time_s, self._angle)
        return PlantBlock(time_s=time_s, force_n=np.zeros(n), angle_rad=seen, motor_rad=np.zeros(n))

    def truth(self) -> NDArray[np.float64]:
        """The angles, rad."""
        return self._angle[::2]


def make_pose_plant(bench: ActionPlant, text: str, where: str) -> PosePlant:
    """Plant that holds a body at the angles, rad, that ``BODY:A,B,…`` lists."""
    body, _, listed = text.partition(":")
    try:
        angles = [float(one) for one in listed.split(",")]
    except ValueError:
        angles = []
    if body not in ENCODED_BODIES or not angles or not np.isfinite(angles).all():
        raise RigInputError(f"{where}: pose = {text!r}, allowed as in key:0,0.01,0.02 with {', '.join(ENCODED_BODIES)}")
    rest = model.rest_state(bench.action).angle_rad
    encoded = np.array([rest[model.BODIES.index(name)] for name in ENCODED_BODIES])
    return PosePlant(encoded, body, angles, bench.sample_rate_hz)


LET_GO_S = 0.6  # after the lift
LIFTED_RAD = 1.1  # rad from rest: as far as a hand lifts a hammer
SLIP_RAD_PER_S = 1e-3  # over which the friction changes its sign: choice


@dataclass(frozen=True)
class Pad:
    """A pad on a drum of ``radius_m`` about the axis, under ``load_n``; A, B1, B2 and v_t of its contact's friction."""

    load_n: float
    radius_m: float
    a: float
    b1: float
    b2: float
    v_t: float

    def torque(self, speed: float) -> float:
        """Friction torque against a speed, rad/s; N m, positive."""
        s = abs(speed) * self.radius_m / self.v_t
        return self.load_n * self.radius_m * self.a * (math.tanh(s) + self.b1 * s / (1.0 + self.b2 * s**4))


class SwingPlant:
    """One body on its joint; implements `rig.simulated.bench.plant_protocol.Plant`."""

    def __init__(self, action: model.Action, body: str, sample_rate_hz: float, pad: Pad | None = None) -> None:
        self.sample_rate_hz = sample_rate_hz
        self._pad = pad
        self._body = ENCODED_BODIES.index(body)
        arm = math.hypot(action[f"{body}.center_of_mass.x"], action[f"{body}.center_of_mass.y"])
        self.weight_nm = action[f"{body}.mass"] * action["gravity.g"] * arm
        self.friction_nm = action[f"{body}.joint_friction.A"]
        self._inertia = action[f"{body}.inertia"] + action[f"{body}.mass"] * arm**2
        self.start_trial(1)

    def start_trial(self, trial: int) -> None:
        self._angle, self._speed, self._edge = LIFTED_RAD * (1.0 + 0.01 * (trial % 7)), 0.0, 0  # other heights

    def advance(self, command_v: NDArray[np.float64]) -> PlantBlock:
        """Swing for n sample periods; the motor has nothing to do with it."""
        n, h = len(command_v), 1.0 / self.sample_rate_hz
        angles = np.empty(n)
        for k in range(n):
            angles[k] = self._angle
            if (self._edge + k) * h >= LET_GO_S:
                self._step(h)
        time_s: NDArray[np.float64] = np.arange(self._edge, self._edge + n, dtype=np.float64) * h
        self._edge += n
        seen = np.zeros((n, len(ENCODED_BODIES)))
        seen[:, self._body] = angles
        return PlantBlock(time_s=time_s, force_n=np.zeros(n), angle_rad=seen, motor_rad=np.zeros(n))

    def truth(self) -> tuple[float, float]:
        """Friction and weight times arm, N m."""
        return self.friction_nm, self.weight_nm

    def _step(self, h: float) -> None:
        """Half a step of weight, one of friction against the speed it leaves, half a step of weight."""
        before = self._speed - 0.5 * h * self.weight_nm / self._inertia * math.sin(self._angle)
        pad = self._pad
        holds = self.friction_nm + (0.0 if pad is None else pad.load_n * pad.radius_m * pad.a)
        most = h * holds / self._inertia
        torque = self.friction_nm * math.tanh(abs(before) / SLIP_RAD_PER_S)
        torque += 0.0 if pad is None else pad.torque(before)
        slowed = math.copysign(max(abs(before) - h * torque / self._inertia, 0.0), before)
        if abs(before) <= most and abs(self.weight_nm * math.sin(self._angle)) <= holds:
            self._speed = 0.0  # it sticks
            return
        self._angle += h * slowed
        self._speed = slowed - 0.5 * h * self.weight_nm / self._inertia * math.sin(self._angle)


def make_swing_plant(bench: ActionPlant, body: str, pad: str = "") -> SwingPlant:
    """Return a body of a bench's specimen on its joint; ``pad`` is ``contact:load_n:radius_m``, or nothing."""
    if body not in ENCODED_BODIES:
        raise RigInputError(f"swing {body}: not found; allowed {', '.join(ENCODED_BODIES)}")
    if b1 := bench.action[f"{body}.joint_friction.B1"]:
        raise RigInputError(f"swing {body}: joint_friction.B1 = {b1:g}, allowed 0: it swings on dry friction")
    return SwingPlant(bench.action, body, bench.sample_rate_hz, _parse_pad(bench.action, pad) if pad else None)


def _parse_pad(action: model.Action, text: str) -> Pad:
    """Rubbing pad from ``CONTACT:LOAD_N:RADIUS_M``, with the contact's friction."""
    try:
        contact, load, radius = text.split(":")
        load_n, radius_m = float(load), float(radius)
        a, b1, b2 = (action[f"{contact}.friction.{k}"] for k in ("A", "B1", "B2"))
        if not (0 < load_n < math.inf and 0 < radius_m < math.inf):
            raise ValueError
    except (ValueError, KeyError, model.ModelError):
        raise RigInputError(f"pad {text}: allowed CONTACT:LOAD_N:RADIUS_M, as contact04:0.2:0.005") from None
    return Pad(load_n, radius_m, a, b1, b2, action["friction_threshold.v_t"])
