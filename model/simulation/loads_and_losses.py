"""What happens inside the action along a motion: forces, sliding, losses and accelerations over the output times.

The model holds the key by a revolute joint; the real key only lies on its rail (thesis Sections 3.2.2, 4.1). Where the
joint's force on the key points down, the key is predicted to lift (`tensions`). By how much needs a scene with a
one-sided rail (effect ``balance_rail``), in which the key does lift (`lifts`).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.arrays import ArrayRecord
from model.files.time_table import two_columns
from model.kernels import layout as L
from model.parameters.effects import RAIL
from model.scene.build import Scene

Array = NDArray[np.float64]

# columns of a contact, named as the attributes of `Inside`
CONTACT_WORDS = {
    "normal_n": "normal force of the second surface on the first",
    "friction_n": "friction force on the first surface along the normal turned by +90 degrees",
    "penetration_m": "depth of the felt, negative where the gap is open",
    "sliding_m_per_s": "speed of the first surface over the second, 0 where the gap is open",
    "slid_m": "way rubbed since the start",
    "rubbed_j": "energy lost by friction since the start",
    "felt_j": "energy lost in the felt since the start",
}
TIP_WORDS = {
    "normal_n": "force of its tip on the key, downwards",
    "felt_j": "energy lost at its tip since the start",
}
BODY_WORDS = {
    "joint_x_n": "force on it in its joint, to the right",
    "joint_y_n": "force on it in its joint, upwards",
    "joint_rubbed_j": "energy lost by friction in its joint since the start",
    "center_x_m_per_s": "velocity of the centre of mass, to the right",
    "center_y_m_per_s": "velocity of the centre of mass, upwards",
    "center_x_m_per_s2": "acceleration of the centre of mass, to the right",
    "center_y_m_per_s2": "acceleration of the centre of mass, upwards",
    "from_ground_rad_per_s": "angular speed of the whole body from ground",
    "from_ground_rad_per_s2": "angular acceleration of the whole body from ground",
}


@dataclass(frozen=True)
class RailTension:
    """An interval in which the rail would have to pull: its ends (s), largest pull (N) and when, impulse (N s)."""

    start_s: float
    end_s: float
    largest_n: float
    largest_at_s: float
    impulse_ns: float


@dataclass(frozen=True)
class RailLift:
    """An interval in which the key is off its rail: its ends (s), greatest height (m) and when."""

    start_s: float
    end_s: float
    largest_m: float
    largest_at_s: float


def _negative_intervals(time_s: ArrayLike, signal: ArrayLike) -> Iterator[tuple[float, float, float, float, float]]:
    """Start, end, largest depth below 0, its time and area of each interval in which a signal (m,), straight between
    its samples, is negative."""
    time_s, signal = two_columns(time_s, signal, "signal of the rail")
    turn = np.flatnonzero((signal[:-1] < 0.0) != (signal[1:] < 0.0))
    share = signal[turn] / (signal[turn] - signal[turn + 1])
    crossing = time_s[turn] + share * (time_s[turn + 1] - time_s[turn])
    edges = np.concatenate([[time_s[0]], crossing, [time_s[-1]]]) if len(time_s) else np.empty(0)
    for start, end in zip(edges[:-1], edges[1:], strict=True):
        inner = (time_s > start) & (time_s < end)
        if end <= start or not np.any(signal[inner] < 0.0):
            continue
        at = np.concatenate([[start], time_s[inner], [end]])
        ends = np.interp([start, end], time_s, signal)
        size = -np.concatenate([ends[:1], signal[inner], ends[1:]])
        k = int(np.argmax(size))
        yield float(start), float(end), float(size[k]), float(at[k]), float(np.trapezoid(size, at))


def tensions(time_s: ArrayLike, upwards_n: ArrayLike) -> list[RailTension]:
    """Intervals (ends s, largest pull N, its time s, impulse N s) in which the rail's force on the key, positive up, is
    negative: there the rail would have to pull.

    Parameters
    ----------
    time_s : (m,) increasing, s
    upwards_n : (m,) force of the rail on the key, N, positive upwards

    Returns
    -------
    list of RailTension
        Ends, s, largest pull, N, and when, impulse, N s.

    Examples
    --------
    >>> import numpy as np
    >>> import model
    >>> pull, = model.inside.tensions(np.array([0.0, 1.0, 2.0]), np.array([4.0, -4.0, 4.0]))
    >>> pull.largest_n, pull.impulse_ns
    (4.0, 2.0)
    """
    return [RailTension(*interval) for interval in _negative_intervals(time_s, upwards_n)]


def lifts(time_s: ArrayLike, depth_m: ArrayLike) -> list[RailLift]:
    """Intervals (ends s, greatest height m, its time s) in which the rail's felt is not touched: ``depth_m`` is
    negative.

    Parameters
    ----------
    time_s : (m,) increasing, s
    depth_m : (m,) depth of the felt, m, negative where the key is off it

    Returns
    -------
    list of RailLift
        Ends, s, greatest height, m, and when.

    Examples
    --------
    >>> import numpy as np
    >>> import model
    >>> lift, = model.inside.lifts(np.array([0.0, 1.0, 2.0]), np.array([1e-3, -1e-3, 1e-3]))
    >>> lift.start_s, lift.end_s, lift.largest_m
    (0.5, 1.5, 0.001)
    """
    return [RailLift(*interval[:4]) for interval in _negative_intervals(time_s, depth_m)]


@dataclass(frozen=True)
class Inside(ArrayRecord):
    """Loads, losses and motion of contacts (c) and of bodies with their joints (n) at (m,) times.

    Attributes
    ----------
    scene : elements of the run, with all their numbers
    time_s : (m,)
    normal_n, friction_n : (m, c) force of the second surface on the first, along the normal and along t = z x n
    penetration_m : (m, c) depth of the felt, negative where the gap is open
    sliding_m_per_s : (m, c) speed of the first surface over the second along t; 0 where the gap is open
    slid_m : (m, c) way rubbed since the start, both directions added
    rubbed_j, felt_j : (m, c) energy lost since the start by friction and in the felt
    point_m : (m, c, 2) where the force acts
    tip_n, tip_j : (m, b) force of what presses the key and energy lost at its tip since the start; b is 0 or 1
    joint_n : (m, n, 2) force on a body from what carries it, in its joint
    joint_j : (m, n) energy lost since the start by friction in the joint
    center_m_per_s, center_m_per_s2 : (m, n, 2) velocity and acceleration of the centre of mass
    angle_rad_per_s, angle_rad_per_s2 : (m, n) of the whole body, from ground
    pose : (m, n, 3) pivot x, y (m) and orientation from ground (rad)
    largest_normal_n : (c,) over all evaluated times, not only the output times
    dense_time_s, dense_joint_n : (k,), (k, n, 2) the joints' forces at all evaluated times
    dense_rail_m : (k,) depth of the one-sided rail's felt, negative where the key is off; 0 without such a rail
    error_j : bound on the error of the energies
    """

    scene: Scene
    time_s: Array
    normal_n: Array
    friction_n: Array
    penetration_m: Array
    sliding_m_per_s: Array
    slid_m: Array
    rubbed_j: Array
    felt_j: Array
    point_m: Array
    tip_n: Array
    tip_j: Array
    joint_n: Array
    joint_j: Array
    center_m_per_s: Array
    center_m_per_s2: Array
    angle_rad_per_s: Array
    angle_rad_per_s2: Array
    pose: Array
    largest_normal_n: Array
    dense_time_s: Array
    dense_joint_n: Array
    dense_rail_m: Array
    error_j: float

    @property
    def contacts(self) -> tuple[str, ...]:
        """Names of the contacts."""
        return self.scene.contacts

    @property
    def bodies(self) -> tuple[str, ...]:
        """Names of the coordinates; each is a body with its joint, or a guide without mass (the key's lift)."""
        return self.scene.bodies

    @property
    def turning_bodies(self) -> tuple[str, ...]:
        """Bodies proper: without guides."""
        return tuple(b for b, w in zip(self.bodies, self.scene.tables.parent, strict=True) if w != L.GUIDED)

    def columns(self) -> dict[str, Array]:
        """Columns of the output file by name, without times: forces, sliding and losses of contacts, then of the tip,
        then joint forces and losses and motion of bodies."""
        out: dict[str, Array] = {}
        for i, name in enumerate(self.contacts):
            out |= {f"{name}_{quantity}": getattr(self, quantity)[:, i] for quantity in CONTACT_WORDS}
        for tip_n, tip_j in zip(self.tip_n.T, self.tip_j.T, strict=True):
            out |= {f"{self.scene.presser}_{key}": x for key, x in zip(TIP_WORDS, (tip_n, tip_j), strict=True)}
        of_bodies = dict(
            zip(
                BODY_WORDS,
                (
                    *np.moveaxis(self.joint_n, 2, 0),
                    self.joint_j,
                    *np.moveaxis(self.center_m_per_s, 2, 0),
                    *np.moveaxis(self.center_m_per_s2, 2, 0),
                    self.angle_rad_per_s,
                    self.angle_rad_per_s2,
                ),
                strict=True,
            )
        )
        joints = [name for name in BODY_WORDS if name.startswith("joint_")]
        for bodies, names in ((self.bodies, joints), (self.turning_bodies, [n for n in BODY_WORDS if n not in joints])):
            for body in bodies:
                out |= {f"{body}_{name}": of_bodies[name][:, self.bodies.index(body)] for name in names}
        return out

    def key_tensions(self) -> list[RailTension]:
        """Return the intervals in which a joint at the balance rail would have to pull the key down: predicted lift.
        Empty where the key lies on a one-sided rail (see `key_lifts`)."""
        if RAIL in self.contacts:
            return []
        return tensions(self.dense_time_s, self.dense_joint_n[:, self.bodies.index("key"), 1])

    def key_lifts(self) -> list[RailLift]:
        """Intervals in which the key is off its one-sided rail; empty where a joint keeps it there."""
        if RAIL not in self.contacts:
            return []
        return lifts(self.dense_time_s, self.dense_rail_m)

    def long_names(self, described: Mapping[str, str]) -> dict[str, str]:
        """Description of each column; ``described`` names the contacts."""
        tip = self.scene.presser
        out = {f"{tip}_{key}": f"{tip.replace('_', ' ')}: {words}" for key, words in TIP_WORDS.items() if tip}
        for name in self.contacts:
            out |= {f"{name}_{key}": f"{described.get(name, name)}: {words}" for key, words in CONTACT_WORDS.items()}
        for body in self.bodies:
            out |= {f"{body}_{key}": f"{body}: {words}" for key, words in BODY_WORDS.items()}
        return out
