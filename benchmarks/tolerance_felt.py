"""Is the requested tolerance kept with felt that remembers, a string and other effects, each alone and all together?

    python benchmarks/tolerance_felt.py [--blow forte]

For every element and request: largest error of an angle over the request, against a run at 1e-12 (a string of 75 modes
in all runs: what is left out is another matter, `string_modes.py`); s where the run's estimate calls it missed. Then
the energy that does not close at 1e-9, of the work put in, and the order observed: how errors fall with the mean step.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import model
from model.parameters.action import CONTACTS

REQUESTS = tuple(10.0**-k for k in range(3, 10))
EXACT = 1e-12
LEAST = 1e-12  # rad, of an error that says something about the order
MIXED = {c: "stulov" if k % 3 == 1 else "hysteresis" for k, c in enumerate(CONTACTS) if c != "contact12"}
ELEMENTS: dict[str, tuple[dict[str, str], tuple[str, ...]]] = {
    "none": ({}, ()),
    "stulov": (dict.fromkeys(CONTACTS, "stulov"), ()),
    "hysteresis": (dict.fromkeys(CONTACTS, "hysteresis"), ()),
    "string": ({}, ("string",)),
    "balance rail": ({}, ("balance_rail",)),
    "shank": ({}, ("shank",)),
    "all together": (MIXED, ("balance_rail", "shank", "string")),
}


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--blow", default="forte")
    given = parser.parse_args()
    plain, table = model.load_action("hirschkorn2004-regulated"), model.force_table(given.blow)
    plain = plain.with_effects({"string.modes": 75.0})
    at = np.linspace(table[0][0], table[0][-1], 701)
    print(f"{given.blow}: error over request")
    print(f"{'':<14}" + "".join(f"{r:>9.0e}" for r in REQUESTS) + f"{'energy':>10}{'order':>7}")
    for name, (laws, effects) in ELEMENTS.items():
        action, choice = plain.with_laws(laws), model.SceneChoice(effects=effects)

        def run(tolerance: float, **keywords: bool) -> model.Solution:
            return model.simulate(
                action, *table, scene=choice, tolerance=tolerance, output_time_s=at, **keywords  # noqa: B023
            )  # fmt: skip

        exact = run(EXACT)
        cells, errors, steps = "", [], []
        for request in REQUESTS:
            found = run(request)
            error = float(np.max(np.abs(found.angle_rad - exact.angle_rad)[:, :5]))
            said = error > 10.0 * request and run(request, estimate_error=True).misses_tolerance
            cells += f"{error / request:>{7 if said else 9}.2g}" + (" s" if said else "")
            errors.append(max(error, LEAST))
            steps.append(found.counters["n_steps"])
        energy = run(1e-9, energy=True).energy
        assert energy is not None
        order = -np.polyfit(np.log(steps[1:]), np.log(errors[1:]), 1)[0]
        print(f"{name:<14}{cells}{abs(energy.residual) / energy.work_in:>10.1e}{order:>7.1f}", flush=True)


if __name__ == "__main__":
    main()
