"""What a string costs in the action, and what the modes that are left out are worth, against their number.

    python benchmarks/string_modes.py [--blow forte] [--tolerance 1e-5] [--repeats 7]

Processor time of a run, least of several taken in turns, beside the bar's; error of the largest angle against 100 modes
at a hundredth of the tolerance.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import model

MODES = (0, 5, 10, 20, 30, 40, 60, 80, 100)


def main() -> None:
    """Print one line for each number of modes."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--blow", default="forte")
    parser.add_argument("--tolerance", type=float, default=1e-5)
    parser.add_argument("--repeats", type=int, default=7)
    given = parser.parse_args()
    action, table = model.load_action("hirschkorn2004-regulated"), model.force_table(given.blow)
    at = np.linspace(table[0][0], table[0][-1], 701)
    rest = model.rest_state(action)

    def run(modes: int | None, tolerance: float) -> tuple[model.Solution, float]:
        scene = "whole" if modes is None else "string"
        chosen = action if modes is None else action.with_effects({"string.modes": float(modes)})
        begin = time.process_time()
        found = model.simulate(chosen, *table, scene=scene, tolerance=tolerance, output_time_s=at, initial=rest)
        return found, time.process_time() - begin

    exact, _ = run(100, 0.01 * given.tolerance)
    least: dict[int | None, float] = {}
    for _ in range(given.repeats):
        for modes in (None, *MODES):
            least[modes] = min(least.get(modes, np.inf), run(modes, given.tolerance)[1])
    print(f"{given.blow}, tolerance {given.tolerance:g} rad; bar {1e3 * least[None]:.1f} ms")
    print(f"{'modes':>18}{'ms':>8}{'of the bar':>12}{'steps':>8}{'error rad':>11}")
    for modes in MODES:
        found, _ = run(modes, given.tolerance)
        error = float(np.max(np.abs(found.angle_rad - exact.angle_rad)))
        name = f"by tolerance: {found.counters['string_modes']}" if modes == 0 else str(modes)
        ratio, steps = least[modes] / least[None], found.counters["n_steps"]
        print(f"{name:>18}{1e3 * least[modes]:>8.1f}{ratio:>12.2f}{steps:>8}{error:>11.1e}")


if __name__ == "__main__":
    main()
