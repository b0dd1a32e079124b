"""Does every plausible action run, and does every absurd one give a correct result or a typed error?

    python -m benchmarks stability [--count 10000] [--seed 1] [--set A,B] [--workers 2] [--case N]

Set A (plausible): geometry +-2 mm, everything else +-50 %, v_t 1e-2..1e-5, forces to 120 N with 0.2 ms edges; at
least 99.9 % must finish. Set B (abuse): geometry +-50 %, no damping, no friction, deep penetration at start,
v_t to 1e-6, NaN and infinite force; each must give a correct result or a typed error with advice.
Correct means: the energy balance, computed independently of the compiled equations, closes to 1e-4 of the turnover;
and, for at least one case in twenty, the angles agree with a run at a hundredth of the tolerance (`stability_cases`).
No case can hang: steps are bounded. A case is plain data generated from (set, seed, number); ``--case`` runs one alone,
against a finer run, and prints all that is known of it.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import asdict
from typing import Any

from benchmarks.runner import Run
from benchmarks.stability_cases import FACTOR, MAKERS, TOLERANCE, Result, run_case

LEAST_SHARE = 0.999  # of set A
ONE_IN = {"A": 20, "B": 8}  # cases checked against a finer run if they finish


def judged(name: str, seed: int, number: int, always: bool = False) -> dict[str, Any]:
    """One case as plain data; ``always`` against a finer run."""
    return asdict(run_case(MAKERS[name](seed, number), finer=always or number % ONE_IN[name] == 0))


def report(name: str, results: list[Result]) -> bool:
    """Print the results of one set; return whether they meet the requirements."""
    count = len(results)
    tally = Counter(r.outcome for r in results)
    finished = [r for r in results if r.outcome == "finished"]
    wrong = sum(n for outcome, n in tally.items() if outcome.startswith("wrong"))
    print(f"\nset {name}: {count} cases")
    for outcome, n in tally.most_common():
        print(f"  {n:6d}  {100 * n / count:7.3f} %  {outcome}")
    if not finished:
        return wrong == 0
    slow, heavy = max(results, key=lambda r: r.seconds), max(finished, key=lambda r: r.steps)
    loose = max(finished, key=lambda r: r.residual)
    print(f"  longest run time         {slow.seconds:.2f} s (case {slow.number}, {slow.outcome})")
    print(f"  most steps of a finished {heavy.steps} (case {heavy.number})")
    print(f"  worst energy residual    {loose.residual:.1e} of the turnover (case {loose.number})")
    checked = [r for r in finished if r.difference is not None]
    if checked:
        plain = [r for r in checked if r.growth is None]
        grown = [r for r in checked if r.growth is not None]
        print(
            f"  checked at {TOLERANCE / 100:g} rad     {len(checked)} cases: {len(plain)} within {FACTOR:g} tolerances"
        )
        print(f"    {len(grown)} more explained by the growth of a disturbance of {TOLERANCE:g} rad:")
        for r in sorted(grown, key=lambda r: r.growth or 0.0)[:20]:
            print(f"    case {r.number}: {r.difference:.1e} rad off, growth {r.growth:.1e}")
    for r in (r for r in results if r.detail and (r.outcome == "finished" or r.outcome.startswith("wrong"))):
        print(f"    case {r.number}: {r.outcome}: {r.detail}")
    if name == "A":
        return wrong == 0 and len(finished) >= LEAST_SHARE * count
    return wrong == 0


def main(run: Run) -> bool:
    """Run the sets asked for; whether all meet the requirements."""
    if run.case >= 0:
        rows = [judged(name, run.seed, run.case, always=True) for name in run.set]
        print("\n".join(f"{key:10} {value}" for row in rows for key, value in row.items()))
        return not any(row["outcome"].startswith("wrong") for row in rows)
    good = True
    for name in run.set:
        keys = [(name, run.seed, number) for number in range(run.count)]
        results = [Result(**row) for _, row in run.cases(keys, judged, run.workers)]
        good &= report(name, results) if results else False
    return good
