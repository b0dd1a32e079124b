"""What presses the key in place of a given force: motor arm with or without its drive, or a finger.

Equations, and what they leave out: docs/explanation/string_and_motor.md.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from model.codegen.evaluate_observables import evaluate_rows
from model.codegen.load import load_kernel
from model.errors import InputError
from model.kernels import layout as L
from model.parameters.action import Action
from model.parameters.effects import ARM, FINGER, MOTOR, MOTOR_DRIVE, WINDING

Array = NDArray[np.float64]
TIP = {MOTOR: (ARM, "contact_", "motor_arm.joint_friction"), FINGER: (FINGER, "pad_", None)}
RAMP_S = 2e-9  # s, in which a force jumps: steps land on either end; a jump proper is seen early by a step's last stage
SATURATED = 2.0  # commands beyond so many times the supply ask for nothing more
DRIVE_NUMBERS = ("loop_gain", "supply", "current_limit", "limit_gain", "limit_softness")


@dataclass(frozen=True)
class AmplifierCommand:
    """Command voltage to the amplifier's source voltage: a gain, and where commands are cut off."""

    per_volt: float
    largest_v: float

    def value(self, value: float) -> float:
        """Source voltage, V, for a constant command ``value``, V."""
        return min(max(self.per_volt * value, -self.largest_v), self.largest_v)

    def table(self, time_s: Array, value: Array, held: bool) -> tuple[Array, Array]:
        """Times (s), with those at which a limit is met, and the amplifier's source voltage (V) there, clipped, for a
        command ``value`` (V) at ``time_s``, linear between its points or ``held``."""
        source, largest = self.per_volt * value, self.largest_v
        if not held:
            at = [time_s]
            for level in (largest, -largest):
                before, after = source[:-1] - level, source[1:] - level
                k = np.flatnonzero(before * after < 0.0)
                at.append(time_s[k] + (time_s[k + 1] - time_s[k]) * before[k] / (before[k] - after[k]))
            times = np.unique(np.concatenate(at))
            time_s, source = times, np.interp(times, time_s, source)
        return time_s, np.clip(source, -largest, largest)


@dataclass(frozen=True)
class FingerCommand:
    """Hand displacement (m, down) to the torque of muscle spring and damper on the finger held still (N m)."""

    length_m: float
    stiffness_n_per_m: float
    damping_n_s_per_m: float

    def value(self, value: float) -> float:
        """Torque, N m, of a hand that rests at the displacement ``value`` (m, down)."""
        return self.length_m * self.stiffness_n_per_m * value

    def table(self, time_s: Array, value: Array, held: bool) -> tuple[Array, Array]:
        """Times (s) and the finger's torque (N m) there, for a displacement of the hand ``value`` (m, down) at
        ``time_s`` (s), linear between its points; `InputError` for ``held`` values.

        A ramp of 2 ns stands where the hand's speed jumps.
        """
        if held:
            raise InputError(
                "finger: found a motion held from point to point, allowed one that runs straight between them"
            )
        if np.any(np.diff(time_s) <= RAMP_S):
            raise InputError(f"finger: found times of its motion closer than {RAMP_S:g} s, allowed further apart")
        if len(time_s) == 1:
            return time_s, self.length_m * self.stiffness_n_per_m * value
        slope = np.concatenate([[0.0], np.diff(value) / np.diff(time_s), [0.0]])
        force = self.stiffness_n_per_m * value
        jump = slope[1:] != slope[:-1]
        jump[0] = False  # before its table the hand is where the table starts: no time to move from
        half = np.where(jump, 0.5 * RAMP_S, 0.0)
        times = np.concatenate([(time_s + half), (time_s - half)[jump]])
        force = np.concatenate(
            [force + self.damping_n_s_per_m * slope[1:], (force + self.damping_n_s_per_m * slope[:-1])[jump]]
        )
        order = np.argsort(times, kind="stable")
        return times[order], self.length_m * force[order]


Command = AmplifierCommand | FingerCommand
"""Turns the input of a run into what the kernels are given."""


def presser_of(bodies: list[str]) -> str | None:
    """The coordinate that presses the key, or None where a force on the key drives the scene."""
    return next((b for b in (MOTOR, FINGER) if b in bodies), None)


class Presser(NamedTuple):
    """Numbers of what presses the key: its body, the spring on its joint with the preload, its tip, its damper.

    ``tip``: tip, point of the key, law of what gives way between; ``damping``: N m s/rad.
    """

    body: list[float]
    spring: list[float]
    tip: list[float]
    damping: float


def presser_numbers(action: Action, body: str, key_rad: float) -> Presser:
    """Return the numbers of the presser ``body`` (`MOTOR` or `FINGER`) of an action: body, spring, tip, damper; its tip
    lies on the key at the absolute angle ``key_rad``."""
    section, law, friction = TIP[body]
    x, y = action["drive.point.x"], action["drive.point.y"]
    c, s = math.cos(key_rad), math.sin(key_rad)
    tip_x, tip_y = action["key.pivot.x"] + c * x - s * y, action["key.pivot.y"] + s * x + c * y
    length, damping = action[f"{section}.length"], 0.0
    if body == MOTOR:
        inertia, stiff = action["motor_arm.inertia"], action["motor_arm.spring_stiffness"]
    else:
        inertia, stiff = action["finger.mass"] * length * length, action["finger.stiffness"] * length * length
        damping = action["finger.damping"] * length**2
    rub = 0.0 if friction is None else action[friction]
    return Presser(
        [tip_x + length, tip_y, 0.0, 0.0, 0.0, inertia, rub, 0.0, 0.0],
        [action[f"{section}.preload_n"] * length, stiff, 0.0],
        [-length, 0.0, x, y, *(action[f"{section}.{law}{k}"] for k in ("a", "b", "c", "damping"))],
        damping,
    )


def drive_numbers(action: Action, bodies: list[str]) -> tuple[list[int], list[float]]:
    """Kind of drive with the index of what it drives, and its parameters, as `model.kernels.layout` orders them."""
    if WINDING in bodies:
        check_drive(action)
        numbers = [action[f"{MOTOR_DRIVE}.{name}"] for name in ("resistance", "torque_constant", *DRIVE_NUMBERS)]
        return [L.AMPLIFIER, bodies.index(WINDING)], numbers
    presser = presser_of(bodies)
    if presser is not None:
        return [L.JOINT_TORQUE, bodies.index(presser)], [0.0, 0.0]
    return [L.FORCE_DOWN, bodies.index("key")], [action["drive.point.x"], action["drive.point.y"]]


def check_drive(action: Action) -> None:
    """Refuse a motor drive that is set neither to torque mode nor to voltage mode."""
    d = {name: action[f"{MOTOR_DRIVE}.{name}"] for name in ("loop_gain", "current_gain", "voltage_gain")}
    torque = d["current_gain"] != 0.0 and d["loop_gain"] > 0.0 and d["voltage_gain"] == 0.0
    voltage = d["current_gain"] == 0.0 and d["loop_gain"] == 0.0 and d["voltage_gain"] != 0.0
    if not (torque or voltage):
        raise InputError(
            f"motor_drive: found current_gain {d['current_gain']:g}, loop_gain {d['loop_gain']:g}, voltage_gain "
            f"{d['voltage_gain']:g}; allowed torque mode (the first two, not the last) or voltage mode (the last alone)"
        )


def command_of(action: Action, bodies: list[str]) -> Command | None:
    """Conversion of a run's input to that of the kernels: a drive's command, V, to its source voltage, a finger's way
    of the hand, m, to its torque; None where they are the same."""
    if WINDING in bodies:
        gain = action["motor_drive.voltage_gain"]
        if gain != 0.0:
            return AmplifierCommand(gain, SATURATED * action["motor_drive.supply"])
        ohm = action["motor_drive.loop_gain"] + action["motor_drive.resistance"]
        return AmplifierCommand(ohm * action["motor_drive.current_gain"], ohm * action["motor_drive.current_limit"])
    if FINGER in bodies:
        return FingerCommand(*(action[f"finger.{name}"] for name in ("length", "stiffness", "damping")))
    return None


def amplifier_voltage(numbers: Array, source_v: Array, current_a: Array) -> Array:
    """Voltage at the winding (m,) by `model.elements.drives.amplifier`; ``numbers`` as in the kernels."""
    x, found = np.column_stack([source_v, current_a]), np.empty((len(current_a), 2))
    own = np.ascontiguousarray(numbers[L.WINDING_AMPLIFIER : L.WINDING_SIZE])
    evaluate_rows(load_kernel((), "amplifier"), x, x, own, found)
    return found[:, 0]


def steady_current(numbers: Array, source_v: float) -> float:
    """Current, A, that a constant source drives through a winding of these ``numbers`` while its motor stands still."""
    most = abs(source_v) / max(numbers[L.WINDING_R], 1e-9) + 1.0
    low, high = -most, most
    for _ in range(200):
        middle = 0.5 * (low + high)
        left = amplifier_voltage(numbers, np.array([source_v]), np.array([middle]))[0] - numbers[L.WINDING_R] * middle
        low, high = (middle, high) if left > 0.0 else (low, middle)
        if high - low <= 1e-15 * most:
            break
    return 0.5 * (low + high)
