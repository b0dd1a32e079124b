"""What a string costs in the action, and what the modes that are left out are worth, against their number.

    python -m benchmarks string_modes [--blow forte] [--tolerance 1e-5] [--repeats 7]

Processor time of a run, least of several taken in turns, beside the bar's; error of the largest angle against 100 modes
at a hundredth of the tolerance.
"""

from __future__ import annotations

import numpy as np

import model
from benchmarks.runner import Run, Table, in_turns


def main(given: Run) -> bool:
    """Print one line for each number of modes; whether those by tolerance keep it."""
    good = True
    action, table = model.load_action("hirschkorn2004-regulated"), model.force_table(given.blow)
    at = np.linspace(table[0][0], table[0][-1], 701)
    rest = model.rest_state(action)

    def run(modes: int | None, tolerance: float) -> model.Solution:
        scene = "whole" if modes is None else "string"
        chosen = action if modes is None else action.with_effects({"string.modes": float(modes)})
        return model.simulate(chosen, *table, scene=scene, tolerance=tolerance, output_time_s=at, initial=rest)

    exact = run(100, 0.01 * given.tolerance)
    jobs = {modes: (lambda modes=modes: run(modes, given.tolerance)) for modes in (None, *given.modes)}
    spent = {modes: 1e3 * times.min() for modes, times in in_turns(jobs, given.repeats).items()}
    print(f"{given.blow}, tolerance {given.tolerance:g} rad; bar {spent[None]:.1f} ms")
    shown = Table("modes:>18s", "ms:8.1f", "of the bar:.2f", "steps:d", "error rad:.1e")
    for modes in given.modes:
        found = run(modes, given.tolerance)
        error = float(np.max(np.abs(found.angle_rad - exact.angle_rad)))
        name = f"by tolerance: {found.counters['string_modes']}" if modes == 0 else str(modes)
        shown.row(name, spent[modes], spent[modes] / spent[None], found.counters["n_steps"], error)
        good &= modes != 0 or error <= 10.0 * given.tolerance
    ratios = {modes: spent[modes] / spent[None] for modes in given.modes}
    given.figure("string-modes", f"{ratios[30]:.2f} / {ratios[0]:.2f} (bar {spent[None]:.1f} ms)")
    return good
