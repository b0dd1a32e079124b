"""Work and precision of a blow on a string: modes in the action's step loop, modes apart, finite differences.

    python -m benchmarks work_precision_string [--speed 2.0] [--out docs/work_precision_string.svg] [--repeats 5]

One hammer, C4, 12 ms. Error: of the hammer's speed after the blow, as a share of the speed before. Reference of the
march of modes and of finite differences: 512 modes at 1e-6; of the step loop, whose hammer turns on an arc and has the
felt of contact12: itself with 100 modes at 1e-10. Processor time, least of several runs in turns.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
from numba import njit
from numpy.typing import NDArray

import model
from benchmarks.runner import Run, Table, in_turns
from model.simulation.run import Simulation, State
from model.string import C4, C4_HAMMER, Hammer, String, strike
from model.string.blow import _march as march_modes

Array = NDArray[np.float64]


def points_at(string: String, step_s: float) -> int:
    """Most intervals of the grid that are stable at a step, s."""
    c2 = string.tension_n * string.length_m / string.mass_kg
    stiff = c2 * string.length_m**2 * string.stiffness
    first = c2 * step_s**2 + 4.0 * string.b2_m2_per_s * step_s
    least = math.sqrt(0.5 * (first + math.sqrt(first**2 + 16.0 * stiff * step_s**2)))
    return int(string.length_m / least / 1.001)


def blow(string: String, hammer: Hammer, speed: float, seconds: float, steps: int) -> tuple[Array, Array]:
    """Force (steps + 1,), N, and speed of the hammer (steps + 1,), m/s, of a felt that follows a power law."""
    step = seconds / steps
    points = points_at(string, step)
    c2 = string.tension_n * string.length_m / string.mass_kg
    numbers = (
        c2, c2 * string.length_m**2 * string.stiffness, string.b1_per_s, string.b2_m2_per_s,
        string.mass_kg / string.length_m, string.length_m / points, string.struck_at * points,
        hammer.mass_kg, hammer.k, hammer.p, speed, step,
    )  # fmt: skip
    return _march(numbers, points, steps)


@njit(cache=False)
def _march(numbers, points, steps):  # type: ignore[no-untyped-def]
    c2, stiff, b1, b2, density, h, place, mass, k, p, speed, dt = numbers
    before, now, after = np.zeros(points + 5), np.zeros(points + 5), np.zeros(points + 5)  # two ghosts at each end
    force, speeds = np.zeros(steps + 1), np.empty(steps + 1)
    left = int(place)
    part = place - left
    z0, z1 = 0.0, speed * dt
    speeds[0] = speed
    wave, bend, old = c2 * dt * dt / (h * h), stiff * dt * dt / h**4, 2.0 * b2 * dt / (h * h)
    lead = 1.0 / (1.0 + b1 * dt)
    for n in range(1, steps + 1):
        depth = z1 - (1.0 - part) * now[left + 2] - part * now[left + 3]
        f = k * depth**p if depth > 0.0 else 0.0
        force[n] = f
        for i in range(3, points + 2):
            second = now[i + 1] - 2.0 * now[i] + now[i - 1]
            fourth = now[i + 2] - 4.0 * now[i + 1] + 6.0 * now[i] - 4.0 * now[i - 1] + now[i - 2]
            lag = before[i + 1] - 2.0 * before[i] + before[i - 1]
            after[i] = 2.0 * now[i] - (1.0 - b1 * dt) * before[i] + wave * second - bend * fourth + old * (second - lag)
        push = dt * dt * f / (density * h)
        after[left + 2] += (1.0 - part) * push
        after[left + 3] += part * push
        for i in range(3, points + 2):
            after[i] *= lead
        after[1], after[points + 3] = -after[3], -after[points + 1]  # pinned: odd about the ends
        z2 = 2.0 * z1 - z0 - dt * dt * f / mass
        speeds[n] = (z2 - z0) / (2.0 * dt)
        z0, z1 = z1, z2
        before, now, after = now, after, before
    return force, speeds


SECONDS = 0.012
METHODS = ("modes, march", "modes, step loop", "finite differences")
RIGHT = 1e-3  # of the finest point of each method
MARCHES = ((8, 512), (16, 1024), (32, 2048), (64, 4096), (128, 8192), (256, 16384))
GRIDS = (512, 1024, 2048, 4096, 8192, 16384)
LOOPS = ((5, 1e-4), (10, 1e-5), (20, 1e-6), (40, 1e-7), (80, 1e-8))


def in_the_loop(speed: float) -> Callable[[int, float], Callable[[], float]]:
    """Hammer alone in the action's step loop: a run's rebound from modes and tolerance."""
    level = model.load_action("hirschkorn2004-regulated")
    level = level.with_values(
        {
            "contact12.first.y": 0.0,
            "contact12.second.y": level["hammer.pivot.y"] + level["contact12.first.radius"],
            "gravity.g": 0.0,
            "hammer.joint_friction": 0.0,
        }
    )
    others = tuple(f"contact{k:02d}" for k in range(1, 14) if k != 12)
    choice = model.SceneChoice(("key", "hammer"), without=others, effects=("string",))
    arm = abs(level["contact12.first.x"])

    def prepared(modes: int, tolerance: float) -> Callable[[], float]:
        scene = model.build_scene(level.with_effects({"string.modes": float(modes)}), choice)

        def run() -> float:
            start = State(0.0, np.array([0.0, 1e-5 / arm]), np.array([0.0, -speed / arm]))
            one = Simulation(scene, start, tolerance)
            one.advance(SECONDS, np.array([0.0, 1.0]), np.zeros(2))
            return float(one.state.speed_rad_per_s[1]) * arm / speed

        return run

    return prepared


def main(run: Run) -> bool:
    """Print the points and draw them; whether the finest of each method are right."""
    speed, loop = run.speed, in_the_loop(run.speed)
    exact = strike(C4, C4_HAMMER, speed, tolerance=1e-6, n_modes=512, seconds=SECONDS).rebound
    exact_loop = loop(100, 1e-10)()

    def marched(modes: int, steps: int) -> float:
        found = march_modes([C4], C4_HAMMER, speed, modes, SECONDS, steps)
        return float("nan") if found is None else -float(found[1][-1, 1]) / speed

    def differences(steps: int) -> float:
        return -float(blow(C4, C4_HAMMER, speed, SECONDS, steps)[1][-1]) / speed

    jobs: dict[tuple[str, str, float], Callable[[], float]] = {}
    jobs |= {("modes, step loop", f"{n} modes, {tol:g}", exact_loop): loop(n, tol) for n, tol in LOOPS}
    jobs |= {("modes, march", f"{n} modes, {k} steps", exact): partial(marched, n, k) for n, k in MARCHES}
    for k in GRIDS:
        jobs["finite differences", f"{points_at(C4, SECONDS / k)} points, {k} steps", exact] = partial(differences, k)
    spent = in_turns(jobs, run.repeats)
    rows = [
        (method, what, abs(work() - right), 1e3 * spent[method, what, right].min())
        for (method, what, right), work in jobs.items()
    ]
    print(f"C4, hammer at {speed:g} m/s; error of its speed after the blow, share of before")
    table = Table("method:20s", "size:26s", "error:10.1e", "ms:10.3f")
    for row in rows:
        table.row(*row)
    fastest = [
        min((ms for name, _, error, ms in rows if name == method and error <= 1e-4), default=np.nan)
        for method in METHODS
    ]
    figure = " / ".join(f"{ms:.1f}" for ms in fastest)
    run.figure("string", f"{figure} ms ([diagram](work_precision_string.svg))")
    if run.out:
        draw(rows, Path(run.out))
    return all(min(error for name, _, error, _ in rows if name == method) < RIGHT for method, *_ in rows)


def draw(rows: list[tuple[str, str, float, float]], path: Path) -> None:
    """Error against time, logarithmic."""
    import matplotlib

    matplotlib.use("Agg")
    matplotlib.rcParams.update({"svg.fonttype": "none", "svg.hashsalt": "work-precision", "font.size": 9})
    import matplotlib.pyplot as plt

    figure, axis = plt.subplots(figsize=(5.0, 3.6))
    marks = {"modes, step loop": ("o-", "#0072B2"), "modes, march": ("s-", "#D55E00")}
    for method in dict.fromkeys(row[0] for row in rows):
        style, colour = marks.get(method, ("^--", "#000000"))
        points = [(ms, error) for name, _, error, ms in rows if name == method]
        axis.loglog(*zip(*points, strict=True), style, color=colour, label=method)
    axis.set_xlabel("processor time of a blow, ms")
    axis.set_ylabel("error of the hammer's speed after it, share")
    axis.grid(True, which="both", lw=0.3)
    axis.legend()
    figure.tight_layout()
    figure.savefig(path, metadata={"Date": None})
