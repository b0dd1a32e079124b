"""A blow on the null model: the key's one equation, and a hammer that rides, flies, rebounds, is caught and comes back.

The hammer *rides* on the jack until let-off, or until it would have to be pulled. It then *flies* under gravity alone.
At the string its speed turns round at once, by the restitution that the string contact's own law gives. While the jack
is out it is *caught*, for good and without a bounce, where the back check first touches it; the action then carries
its weight. It rides again, sharing its angular momentum, when the jack is under it: at let-off or above, where the
joined path meets it. The repetition lever does not act on a hammer in flight, and a hammer in flight weighs nothing.

Fixed steps of the classical Runge-Kutta method; an event counts from the end of its step. In: force table as for
``simulate``; out: the same `Solution`.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..blow import check_force_table, check_output_times
from ..errors import InputError
from ..parameters import BODIES, Action
from ..solution import Solution
from ..statics import RestState
from .path import HAMMER, KEY, Path, Reduced, reduce_action

Array = NDArray[np.float64]

STEP = 5e-5  # s; a sixtieth of the fastest swing of a key on its felt under 60 N
RIDING, FLYING, CAUGHT = 0, 1, 2
STRING = "contact12"


def restitution(speed_m_per_s: float, damping: float) -> float:
    """Rebound speed over impact speed of a mass on felt F = g(x)(1 + D dx/dt), D in s/m.

    From v dv/dx = -g(x)(1 + D v)/m both ways, v/D - log(1 + D v)/D^2 is the same in and out whatever g and m are.
    """
    z = damping * speed_m_per_s
    if z < 1e-6:
        return 1.0 - 2.0 / 3.0 * z
    wanted = z - math.log1p(z)
    low, high = 0.0, min(z, 1.0)  # of the rebound's own D v, which felt that only pushes keeps below 1
    for _ in range(50):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if -middle - math.log1p(-middle) < wanted else (low, middle)
    return 0.5 * (low + high) / z


class _Equation:
    """Acceleration of the key on one path, as a fast look-up."""

    def __init__(self, sigma: Array, path: Path, omega_t: float) -> None:
        columns = (path.mass, path.pull, path.lever, path.dry, path.damp)
        self.rows = [tuple(row) for row in np.column_stack(columns).tolist()]
        self.hammers = np.column_stack([path.mass, path.angle_rad[:, HAMMER], path.ratio[:, HAMMER]])
        self.start, self.per_rad, self.last = float(sigma[0]), 1.0 / float(sigma[1] - sigma[0]), len(sigma) - 2
        self.omega_t = omega_t

    def acceleration(self, s: float, w: float, force: float, load: float = 0.0) -> float:
        """s'' (rad/s^2) under ``force`` (N) on the key and ``load`` (N m) on the coordinate."""
        x = (s - self.start) * self.per_rad
        i = min(max(int(x), 0), self.last)
        a, b = self.rows[i], self.rows[i + 1]
        y = x - i
        pull = a[1] + y * (b[1] - a[1])  # beyond the ends felt goes on as it did before them
        turning = 0.5 * (b[0] - a[0]) * self.per_rad * w * w if 0.0 <= y <= 1.0 else 0.0
        y = min(max(y, 0.0), 1.0)
        friction = (a[3] + y * (b[3] - a[3])) * math.tanh(w / self.omega_t) + (a[4] + y * (b[4] - a[4])) * w
        driven = pull + load + (a[2] + y * (b[2] - a[2])) * force - turning - friction
        return driven / (a[0] + y * (b[0] - a[0]))

    def hammer(self, s: float) -> tuple[float, float, float]:
        """Mass (kg m^2), and the hammer's angle and ratio on this path."""
        x = (s - self.start) * self.per_rad
        i = min(max(int(x), 0), self.last)
        y = min(max(x - i, 0.0), 1.0)
        mass, angle, ratio = (self.hammers[i] + y * (self.hammers[i + 1] - self.hammers[i])).tolist()
        return mass, angle, ratio

    def step(
        self, s: float, w: float, h: float, forces: tuple[float, float, float], load: float
    ) -> tuple[float, float]:
        """One step of the classical Runge-Kutta method; forces at its start, middle and end."""
        a1 = self.acceleration(s, w, forces[0], load)
        w2 = w + 0.5 * h * a1
        a2 = self.acceleration(s + 0.5 * h * w, w2, forces[1], load)
        w3 = w + 0.5 * h * a2
        a3 = self.acceleration(s + 0.5 * h * w2, w3, forces[1], load)
        w4 = w + h * a3
        a4 = self.acceleration(s + h * w3, w4, forces[2], load)
        return s + h * (w + 2.0 * (w2 + w3) + w4) / 6.0, w + h * (a1 + 2.0 * (a2 + a3) + a4) / 6.0


class _March:
    """One run: key (s, w), hammer (phi, omega) above its rest towards the string, and what the hammer does."""

    def __init__(self, action: Action, reduced: Reduced, start_rad: float) -> None:
        self.reduced = reduced
        omega_t = action["friction_threshold.omega_t"]
        self.joined = _Equation(reduced.sigma, reduced.joined, omega_t)
        self.away = _Equation(reduced.sigma, reduced.away, omega_t)
        self.weight = action["hammer.mass"] * action["gravity.g"]
        self.centre = complex(action["hammer.center_of_mass.x"], action["hammer.center_of_mass.y"])
        self.damping = action[f"{STRING}.normal.D"]
        self.reach = abs(complex(action[f"{STRING}.first.x"], action[f"{STRING}.first.y"]))
        self.rest = float(reduced.rest_rad[HAMMER])
        self.check = reduced.check_rad
        self.s, self.w, self.mode, self.jack_out = start_rad, 0.0, RIDING, False
        self.phi, self.omega = self._on_path()

    def _on_path(self) -> tuple[float, float]:
        _, angle, ratio = self.joined.hammer(self.s)
        return self.reduced.up * (angle - self.rest), self.reduced.up * ratio * self.w

    def _gravity(self, phi: float) -> float:
        """Torque of the hammer's weight towards the string, N m."""
        angle = self.rest + self.reduced.up * phi
        return (
            -self.reduced.up * self.weight * (math.cos(angle) * self.centre.real - math.sin(angle) * self.centre.imag)
        )

    def _checked_at(self) -> float:
        i = round((self.s - self.joined.start) * self.joined.per_rad)
        return float(self.check[min(max(i, 0), len(self.check) - 1)])

    def step(self, h: float, forces: tuple[float, float, float]) -> None:
        """Go on by ``h`` seconds; forces at start, middle and end, N."""
        if self.mode == RIDING:
            before = self.omega
            self.s, self.w = self.joined.step(self.s, self.w, h, forces, 0.0)
            self.phi, self.omega = self._on_path()
            pushed = self.reduced.hammer_inertia * (self.omega - before) / h - self._gravity(self.phi)
            if self.s >= self.reduced.let_off:
                self.mode, self.jack_out = FLYING, True
            elif pushed < 0.0:
                self.mode = FLYING
        else:
            load = 0.0
            if self.mode == CAUGHT:
                load = self._gravity(self.phi) * self.reduced.up * self.joined.hammer(self.s)[2]
            self.s, self.w = self.away.step(self.s, self.w, h, forces, load)
            if self.mode == FLYING:
                self._fly(h)
            if self.s >= self.reduced.let_off:
                self.jack_out = True
            path, along = self._on_path()
            if self.jack_out and self.s < self.reduced.let_off and path <= self.phi:
                self.jack_out, self.mode = False, FLYING  # what was caught falls on
            if not self.jack_out and self.phi <= path:
                self._land(path, along)
        if self.phi >= self.reduced.string_rad and self.omega > 0.0:
            self.omega *= -restitution(self.omega * self.reach, self.damping)
            self.phi, self.mode = self.reduced.string_rad, FLYING

    def _fly(self, h: float) -> None:
        turn = self._gravity(self.phi + 0.5 * h * self.omega) / self.reduced.hammer_inertia
        before = self.phi
        self.phi += h * (self.omega + 0.5 * h * turn)
        self.omega += h * turn
        check = self._checked_at()
        if self.jack_out and self.omega < 0.0 and self.phi <= check <= before:
            self.phi, self.omega, self.mode = check, 0.0, CAUGHT

    def _land(self, path: float, along: float) -> None:
        """The hammer comes down on the jack: both go on together with the angular momentum they have."""
        ratio = self.reduced.up * self.joined.hammer(self.s)[2]
        alone, own = self.away.hammer(self.s)[0], self.reduced.hammer_inertia
        if self.omega <= along:
            self.w = (alone * self.w + own * ratio * self.omega) / (alone + own * ratio**2)
            self.mode = RIDING
            self.phi, self.omega = self._on_path()
        else:
            self.phi = path


@lru_cache(maxsize=8)
def _reduced(content: str, kept: _Kept) -> Reduced:
    return reduce_action(kept.action)


class _Kept:
    """An action that is told apart by its content only."""

    def __init__(self, action: Action) -> None:
        self.action = action

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Kept)

    def __hash__(self) -> int:
        return 0


def simulate(
    action: Action,
    time_s: ArrayLike,
    force_n: ArrayLike,
    *,
    tolerance: float = 1e-5,
    output_time_s: ArrayLike | None = None,
    initial: RestState | None = None,
) -> Solution:
    """Predict the motion of the null model under a force on the key; a stand-in for ``model.simulate``.

    Parameters
    ----------
    action : parameter set
    time_s, force_n : (k,) force table, linear between its points, N, positive downwards
    tolerance : taken for the call's sake; the step is fixed and its error far below the model's
    output_time_s : (m,) increasing, within the table; by default the table's own times
    initial : rest state whose key angle the run starts from; by default at rest without force

    Returns
    -------
    Solution : angles and speeds (m, 5); between hammer and the rest of the action the path jumps where it lets go

    Raises
    ------
    InputError : table or times cannot be used
    StaticsError : the action does not balance along the key's way

    Notes
    -----
    Equation and assumptions: `model.null_model.path` and this module. Tables are kept for the last eight actions.
    """
    times, forces = check_force_table(time_s, force_n)
    outputs = check_output_times(output_time_s, times)
    reduced = _reduced(action.content(), _Kept(action))
    sense = 1.0 if reduced.joined.ratio[0, KEY] > 0.0 else -1.0
    start = 0.0
    if initial is not None:
        if np.shape(initial.angle_rad) != (len(BODIES),):
            raise InputError(f"initial state: {np.shape(initial.angle_rad)} angles found, allowed ({len(BODIES)},)")
        start = sense * float(initial.angle_rad[KEY] - reduced.rest_rad[KEY])
    end = float(outputs[-1]) if len(outputs) else float(times[0])
    count = max(1, math.ceil((end - times[0]) / STEP))
    grid = np.linspace(times[0], max(end, times[0] + STEP), 2 * count + 1)
    table = np.interp(grid, times, forces).tolist()
    march = _March(action, reduced, start)
    rows = np.empty((count + 1, 5))
    h = float(grid[2] - grid[0])
    for k in range(count + 1):
        rows[k] = march.s, march.w, march.phi, march.omega, march.mode == RIDING
        if k < count:
            march.step(h, (table[2 * k], table[2 * k + 1], table[2 * k + 2]))
    angle, speed = _angles(reduced, grid[::2], rows, outputs)
    return Solution(
        bodies=BODIES,
        time_s=outputs,
        angle_rad=angle,
        speed_rad_per_s=speed,
        counters={"n_steps": count},
        tolerance=tolerance,
    )


def _angles(reduced: Reduced, time_s: Array, rows: Array, at: Array) -> tuple[Array, Array]:
    """Angles and speeds (m, 5) at times ``at`` from rows of (s, w, phi, omega, riding) at ``time_s``."""
    s, w, phi, omega = (np.interp(at, time_s, rows[:, k]) for k in range(4))
    step = np.clip(np.searchsorted(time_s, at, side="right") - 1, 0, len(time_s) - 1)
    riding = rows[step, 4] > 0.0
    angle, speed = np.empty((len(at), len(BODIES))), np.empty((len(at), len(BODIES)))
    for i in range(len(BODIES)):
        for path, chosen in ((reduced.joined, riding), (reduced.away, ~riding)):
            angle[chosen, i] = np.interp(s[chosen], reduced.sigma, path.angle_rad[:, i])
            speed[chosen, i] = np.interp(s[chosen], reduced.sigma, path.ratio[:, i]) * w[chosen]
    key = reduced.rest_rad[KEY] + reduced.joined.ratio[0, KEY] * s  # also beyond the ends of the tables
    angle[:, KEY] = key
    angle[:, HAMMER] = reduced.rest_rad[HAMMER] + reduced.up * phi
    speed[:, HAMMER] = reduced.up * omega
    return angle, speed
