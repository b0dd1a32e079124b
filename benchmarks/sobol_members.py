"""Processor time of one member of a Sobol' study, and what a study of 60 parameters would take on two cores.

    python -m benchmarks sobol_members [--members 512]

On a machine that does other work too, processor time is what can be counted; a study on two idle cores is its half.
"""

from __future__ import annotations

import time

import numpy as np

import model
from benchmarks.runner import Run, least
from model.screening import Variants, spreads
from model.screening.members import UNIT
from model.screening.sobol import members

COUNT, BASE = 60, 1024


def main(run: Run) -> bool:
    """Measure units of 64 members and print; whether the same members give the same marks."""
    action, blow = model.load_action(), model.force_table("forte")
    names = [path for path, q in action.quantities.items() if q.u > 0.0 and q.value != 0.0][:COUNT]
    drawn = spreads(action, names)
    variants = Variants(action, *blow, tuple(s.parameter for s in drawn))
    random = np.random.default_rng(0)
    values = np.column_stack([s.at(random.random(run.members)) for s in drawn])
    first = variants.marks(values[:UNIT])  # compiles and warms up
    spent = []
    for k in range(0, run.members, UNIT):
        began = time.process_time()
        variants.marks(values[k : k + UNIT])
        spent.append((time.process_time() - began) / len(values[k : k + UNIT]))
    same = np.array_equal(variants.marks(values[:UNIT]), first, equal_nan=True)
    single = least(lambda: model.simulate(action, *blow))
    total, usual = members(COUNT, BASE), float(np.median(spent))
    print(f"a member: {1e3 * usual:.2f} ms of processor time ({1e3 * min(spent):.2f} to {1e3 * max(spent):.2f})")
    print(f"one blow by itself: {1e3 * single:.2f} ms")
    run.figure("sobol", f"{total * usual:.0f} s, {0.5 * total * usual:.0f} s on two cores (100 asked)")
    return same
