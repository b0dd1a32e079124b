"""Is the requested tolerance kept with felt that remembers, a string and other effects, each alone and all together?

    python -m benchmarks tolerance_felt [--blow forte]

For every element and request: largest error of an angle over the request, against a run at 1e-12 (a string of 75 modes
in all runs: what is left out is another matter, `string_modes.py`); s where the run's estimate calls it missed. Then
the energy that does not close at 1e-9, of the work put in, and the order observed: how errors fall with the mean step.
"""

from __future__ import annotations

from functools import partial

import numpy as np

import model
from benchmarks.runner import Run, Table
from model.parameters.action import CONTACTS

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


def main(given: Run) -> bool:
    """Print the table; whether every error above ten times its request is said."""
    plain, table = model.load_action("hirschkorn2004-regulated"), model.force_table(given.blow)
    plain = plain.with_effects({"string.modes": 75.0})
    at, good = np.linspace(table[0][0], table[0][-1], 701), True
    requests = [10.0**-k for k in range(3, 3 + given.requests)]
    print(f"{given.blow}: error over request")
    shown = Table("element:14s", *(f"{request:.0e}:>7s" for request in requests), "energy:.1e", "order:5.1f")
    for name in given.elements or ELEMENTS:
        laws, effects = ELEMENTS[name]
        action, choice = plain.with_laws(laws), model.SceneChoice(effects=effects)
        run = partial(model.simulate, action, *table, scene=choice, output_time_s=at)
        exact = run(tolerance=EXACT)
        cells, errors, steps = [], [], []
        for request in requests:
            found = run(tolerance=request)
            error = float(np.max(np.abs(found.angle_rad - exact.angle_rad)[:, :5]))
            missed = error > 10.0 * request
            said = missed and run(tolerance=request, estimate_error=True).misses_tolerance
            good &= said or not missed
            cells.append(f"{error / request:.2g}" + (" s" if said else ""))
            errors.append(max(error, LEAST))
            steps.append(found.counters["n_steps"])
        energy = run(tolerance=1e-9, energy=True).energy
        assert energy is not None
        order = -np.polyfit(np.log(steps[1:]), np.log(errors[1:]), 1)[0]
        shown.row(name, *cells, abs(energy.residual) / energy.work_in, order)
    return good
