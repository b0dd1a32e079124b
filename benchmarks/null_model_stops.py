"""Random forces on the null model: do key and hammer stay within their stops, and how often does it decline to predict?

Forces are those the virtual rig allows: 0 to 120 N, at most 2,000 N/s, half of them soft (below 4 N), 3 to 12 corners
over one second, on both shipped actions. Prints the extremes beside those of the five-body model on every 20th force.
Exit code 1 when a body leaves its stops without a word.
"""

from __future__ import annotations

import numpy as np

import model
from benchmarks.runner import Run
from model.errors import ModelError
from model.null_model.reduction import HAMMER, KEY

LARGEST_N, SLEW_N_PER_S, SOFT_N = 120.0, 2000.0, 4.0
LENGTH_S, RATE_HZ = 1.0, 5000.0
BESIDE = 20  # every so many forces the five bodies are run as well


def random_force(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """A force table within the rig's limits, s and N."""
    time = np.arange(int(LENGTH_S * RATE_HZ) + 1) / RATE_HZ
    corners = int(rng.integers(3, 13))
    at = np.sort(rng.uniform(0.02, LENGTH_S, corners))
    peak = SOFT_N if rng.random() < 0.5 else LARGEST_N * rng.random() ** 2
    force = np.interp(time, np.concatenate([[0.0], at]), np.concatenate([[0.0], peak * rng.random(corners)]))
    most = SLEW_N_PER_S / RATE_HZ
    for i in range(1, force.size):
        force[i] = min(max(force[i], force[i - 1] - most), force[i - 1] + most)
    return time, force


def main(run: Run) -> bool:
    """Print extremes; whether no body leaves its stops."""
    good = True
    for name in ("hirschkorn2004", "hirschkorn2004-regulated"):
        action = model.load_action(name)
        rng = np.random.default_rng([run.seed, len(name)])
        reduced = model.null_model.reduce_action(action)
        extremes = {which: [np.inf, -np.inf, np.inf, -np.inf] for which in ("null", "five bodies")}
        declined = 0
        for n in range(run.forces):
            time, force = random_force(rng)
            runs = {"null": model.null_model.simulate}
            if n % BESIDE == 0:
                runs["five bodies"] = model.simulate
            for which, simulate in runs.items():
                try:
                    angle = simulate(action, time, force, tolerance=1e-4).angle_rad
                except ModelError as error:
                    declined += which == "null"
                    print(f"{name}: {which} declines force {n}: {error}")
                    continue
                key = reduced.joined.ratio[0, KEY] * (angle[:, KEY] - reduced.rest_rad[KEY])
                hammer = reduced.up * (angle[:, HAMMER] - reduced.rest_rad[HAMMER])
                new = key.min(), key.max(), hammer.min(), hammer.max()
                extremes[which] = [f(a, b) for f, a, b in zip((min, max, min, max), extremes[which], new, strict=True)]
        print(f"{name}: {run.forces} forces, {declined} declined; string at {reduced.string_rad:.4f} rad")
        for which, (a, b, c, d) in extremes.items():
            print(f"  {which:12s} key {a:+.4f} to {b:+.4f} rad, hammer {c:+.4f} to {d:+.4f} rad")
        a, b, c, d = extremes["null"]
        good &= a >= reduced.sigma[0] and b <= reduced.sigma[-1] and c >= -0.01 and d <= reduced.string_rad + 1e-9
    return good
