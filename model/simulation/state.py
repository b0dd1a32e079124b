"""The state of a run as plain data, checked; with what felt of the scene remembers.

Saving it and going on later gives the same numbers to the last bit as going on at once.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from model.arrays import ArrayRecord
from model.derived.columns import DEPTH
from model.derived.load import kernels_of
from model.derived.observe import contacts_at
from model.elements.structure import Structure
from model.errors import InputError
from model.kernels import layout as L
from model.kernels import workspace as W
from model.scene.build import Scene
from model.simulation.statics import with_pins
from model.simulation.string_motion import straight

TIME_SLACK = 1e-9  # s, rounding of times computed in different ways
LARGEST_ANGLE, LARGEST_SPEED = 1e3, 1e6  # rad, rad/s


@dataclass
class State(ArrayRecord):
    """State of a run: time (s), angles (n,) rad, speeds (n,) rad/s, next step to try (s), memories (z,).

    Memories are those of felt, then how far joints give (m) and how fast (m/s), then those of a string. Without them a
    run starts with felt that has rested at these angles, joints in balance with it, and a straight string.
    """

    time_s: float
    angle_rad: NDArray[np.float64]
    speed_rad_per_s: NDArray[np.float64]
    step_s: float = 1e-5
    memory: NDArray[np.float64] = field(default_factory=lambda: np.empty(0))

    def copy(self) -> State:
        """An independent copy."""
        return State(self.time_s, self.angle_rad.copy(), self.speed_rad_per_s.copy(), self.step_s, self.memory.copy())

    def check(self, size: int) -> None:
        """Refuse what is no state of ``size`` coordinates."""
        for name, array in (("angles", self.angle_rad), ("speeds", self.speed_rad_per_s)):
            if np.shape(array) != (size,):
                raise InputError(f"state: {np.shape(array)} {name} found, allowed ({size},)")
            if not np.all(np.isfinite(array)):
                raise InputError(f"state: {name} must be finite, found {array}")
        for name, found, limit in (
            ("angles", self.angle_rad, LARGEST_ANGLE),
            ("speeds", self.speed_rad_per_s, LARGEST_SPEED),
        ):
            if np.max(np.abs(found)) > limit:
                raise InputError(f"state: {name} found up to {np.max(np.abs(found)):g}, allowed to {limit:g} (rad, s)")
        if not (np.isfinite(self.time_s) and self.step_s > 0.0 and np.isfinite(self.step_s)):
            raise InputError(
                f"state: found time {self.time_s:g} s, next step {self.step_s:g} s; "
                "allowed finite numbers and a step above 0"
            )


def with_memory(scene: Scene, state: State, u: float = 0.0) -> State:
    """The state with the memories of a scene's felt: its own, or those of felt that has rested at its angles.

    Joints that give are in balance under the input ``u``.

    Raises
    ------
    InputError : memories of another scene
    """
    string, give = straight(scene), len(scene.pins)
    count, found = len(scene.tables.memory) + 2 * give + len(string), np.shape(state.memory)
    if count and found == (0,):
        whole = with_pins(scene, state.angle_rad, u) if give else state.angle_rad
        felt = _rested(scene, state, whole) if len(scene.tables.memory) else np.empty(0)
        return replace(state, memory=np.concatenate([felt, whole[scene.size :], np.zeros(give), string]))
    if found != (count,) or not np.all(np.isfinite(state.memory)):
        raise InputError(f"state: found memories {state.memory}, allowed {count} finite numbers, or none")
    return state


def _rested(scene: Scene, state: State, whole: NDArray[np.float64]) -> NDArray[np.float64]:
    """Memories (z,) of felt that has rested at the angles of the state, followed in ``whole`` by what joints give."""
    w = np.zeros(W.WITH_MEMORY if scene.pins else W.SIZE)
    w[W.Q : W.Q + scene.size] = state.angle_rad
    w[W.Z : W.Z + len(scene.pins)] = whole[scene.size :]  # the static scene remembers nothing else
    kernels_of(scene.static_tables).linearise(w, scene.vector, state.time_s)
    angles = w[None, W.Q : W.Q + len(scene.bodies)]  # with those of a prescribed coordinate
    rows = np.concatenate([whole[scene.size :], np.zeros(len(scene.pins))])[None]
    found = contacts_at(scene.static_tables, scene.vector, angles, np.zeros_like(angles), rows)[0]
    s, p, out = Structure(scene.tables), scene.vector, list[float]()
    for c in dict.fromkeys(s.memory):
        curve = p[s.offset[1] + L.CONTACT_SIZE * c + L.K_A :][:3].tolist()
        numbers = [p[n.args[1]] for n in s.law_numbers(c)]
        out += s.law(c).rested(max(0.0, float(found[c, DEPTH])), tuple(curve), numbers, len(s.memories(c)))
    return np.array(out)


def check_input(
    span_s: tuple[float, float],
    times: NDArray[np.float64],
    values: NDArray[np.float64],
    outputs: NDArray[np.float64],
) -> None:
    """Refuse input that would silently give a wrong answer, for a run over ``span_s``."""
    now, until = span_s
    if not until >= now - TIME_SLACK or np.isinf(until):
        raise InputError(f"end of the run: found {until:g} s, allowed a finite time from now on ({now:g} s)")
    if times.ndim != 1 or times.shape != values.shape or len(times) == 0:
        raise InputError(f"input: found shapes {times.shape} and {values.shape}, allowed two equal rows of numbers")
    if not (np.all(np.isfinite(times)) and np.all(np.isfinite(values))):
        raise InputError("input: found a time or value that is not finite; remove or repair the row")
    if np.any(np.diff(times) <= 0.0):
        raise InputError("input: times found that do not increase; allowed increasing times")
    if len(outputs) and not (
        np.all(np.diff(outputs) >= 0.0) and outputs[0] >= now - TIME_SLACK and outputs[-1] <= until + TIME_SLACK
    ):
        raise InputError(f"output times: allowed increasing, from now ({now:g} s) to the end ({until:g} s)")
