"""A key moved by a servo, compiled: in each block a torque held on the key, found from where the key then is.

In: a scene's numbers and kernels as the step loop takes them (`ServoRun`), the motion that is wanted; out: states and
pull of every block. The servo is that of `model.motion_driven.slow_press`; block by block from Python it took three
times the time.
"""

from math import cos, sin
from typing import Any, NamedTuple

import numpy as np
from numba import types

from model.integrators.rosenbrock import integrate
from model.integrators.step_control import DONE
from model.kernels.compile import step_loop
from model.kernels.kernel_value import KernelType, numba_kernel
from model.kernels.signatures import (
    INTEGRATE,
    Account,
    Coefficients,
    InputTable,
    Limits,
    Outputs,
    SceneNumbers,
    Span,
    StepKernels,
)


class Servo(NamedTuple):
    """A servo on the key: inertia (kg m^2), double pole (1/s), length of a block (s), the key's front and its index."""

    inertia: float
    rate: float
    block: float
    front_x: float
    front_y: float
    key: int


class Wanted(NamedTuple):
    """Angle (rad), speed and acceleration of the key in the middle of each block, (m,)."""

    angle: np.ndarray
    speed: np.ndarray
    acceleration: np.ndarray


class Followed(NamedTuple):
    """What is filled: (m, s) times wanted (given), (m, s, n) angles and speeds, (m,) pull (N) at the key's front.

    ``memory`` (m, s, z) is what felt remembers;
    ``gained`` (m,) is by how much the key's speed changed in a block, ``arm`` (m,) the lever of the pull (m).
    """

    time: np.ndarray
    angle: np.ndarray
    speed: np.ndarray
    memory: np.ndarray
    pull: np.ndarray
    gained: np.ndarray
    arm: np.ndarray


class ServoRun(NamedTuple):
    """The step loop, and what it is given but for span, input and outputs."""

    loop: Any
    scene: SceneNumbers
    kernels: StepKernels
    method: Coefficients
    limits: Limits
    account: Account


_array, _table = types.Array(types.float64, 1, "C"), types.Array(types.float64, 2, "C")
_block = types.Array(types.float64, 3, "C")
_f, _i = types.float64, types.int64
_SPAN, _, _, *_GIVEN = INTEGRATE.args
FOLLOW = types.Tuple((_f, _f, _i))(  # time reached, next step to try, status of the step loop
    types.NamedTuple([_f, _f, _f, _f, _f, _i], Servo),
    types.NamedUniTuple(_array, 3, Wanted),
    _SPAN,
    types.NamedTuple([_table, _block, _block, _block, _array, _array, _array], Followed),
    types.NamedTuple([KernelType(INTEGRATE, of_numba=True), *_GIVEN], ServoRun),
)


@step_loop(FOLLOW)
def follow(servo: Servo, wanted: Wanted, span: Span, out: Followed, run: ServoRun) -> Any:
    """Advance the state of ``span`` in place, block by block from time 0, and fill ``out``; end where the loop does."""
    t, _, step, angle, speed, memory = span
    loop, scene, kernels, method, limits, account = run
    at, pull, unrecorded = np.zeros(2), np.zeros(2), np.empty((0, 0))
    status = DONE
    for i in range(wanted.angle.shape[0]):
        q, v = angle[servo.key], speed[servo.key]
        ahead = q + 0.5 * servo.block * v  # where the key would be in the middle of the block
        arm = servo.front_x * cos(q) - servo.front_y * sin(q)
        turn = wanted.acceleration[i] + servo.rate**2 * (wanted.angle[i] - ahead)
        turn += 2.0 * servo.rate * (wanted.speed[i] - v)
        at[0], at[1] = i * servo.block, (i + 1) * servo.block
        pull[:] = -servo.inertia * turn / arm
        t, step, status = loop(
            Span(at[0], at[1], step, angle, speed, memory),
            InputTable(at, pull, False),
            Outputs(out.time[i], out.angle[i], out.speed[i], out.memory[i], unrecorded),
            scene,
            kernels,
            method,
            limits,
            account,
        )
        if status != DONE:
            break
        out.pull[i], out.arm[i], out.gained[i] = pull[0], arm, speed[servo.key] - v
    return t, step, status


STEP_LOOP = numba_kernel(integrate, INTEGRATE)
"""The step loop as a value."""
