"""Does every plausible action run, and does every absurd one give a correct result or a typed error?

    python benchmarks/stability.py [--count 10000] [--seed 1] [--set A|B|AB] [--workers 2] [--replay FILE]

Set A (plausible): geometry +-2 mm, everything else +-50 %, v_t 1e-2..1e-5, forces to 120 N with 0.2 ms edges; at
least 99.9 % must finish. Set B (abuse): geometry +-50 %, no damping, no friction, deep penetration at start,
v_t to 1e-6, NaN and infinite force; each must give a correct result or a typed error with advice.
Correct means: the energy balance, computed independently of the compiled equations, closes to 1e-4 of the turnover;
and, for at least one case in twenty, the angles agree with a run at a hundredth of the tolerance (`stability_cases`).
No case can hang: steps are bounded, and a worker that is silent for five minutes is terminated and its cases listed.
A case is plain data generated from (set, seed, number); failures go to ``--failures``, and ``--replay`` reruns them.
Exits with 1 if a required share is missed or any result is wrong.
"""

from __future__ import annotations

import argparse
import faulthandler
import multiprocessing
import signal
import sys
import time
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import asdict
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from benchmarks.stability_cases import FACTOR, MAKERS, TOLERANCE, Case, Result, load_case, run_case, save_case

LEAST_SHARE = 0.999  # of set A
ONE_IN = {"A": 20, "B": 8}  # cases checked against a finer run if they finish
CHUNK = 5
SILENCE_S = 300.0  # for one case before its worker is terminated


def start_worker() -> None:
    """Leave Ctrl-C to the main process."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def run_chunk(name: str, seed: int, numbers: range) -> list[tuple[Case, Result]]:
    """Run some cases in a worker; keep the cases worth saving."""
    out = []
    for number in numbers:
        case = MAKERS[name](seed, number)
        faulthandler.dump_traceback_later(SILENCE_S, exit=True)
        out.append((case, run_case(case, finer=number % ONE_IN[name] == 0)))
        faulthandler.cancel_dump_traceback_later()
    return out


def run_all(name: str, seed: int, count: int, workers: int) -> Iterator[tuple[Case, Result]]:
    """Yield cases and results as they arrive; a worker that dies or hangs yields a result for each of its cases."""
    chunks = iter([range(i, min(i + CHUNK, count)) for i in range(0, count, CHUNK)])
    pool = ProcessPoolExecutor(workers, multiprocessing.get_context("spawn"), start_worker)
    pending: dict[Future[list[tuple[Case, Result]]], range] = {}
    try:
        while True:
            while len(pending) < 2 * workers and (numbers := next(chunks, None)) is not None:
                pending[pool.submit(run_chunk, name, seed, numbers)] = numbers
            if not pending:
                return
            for future in wait(pending, return_when=FIRST_COMPLETED).done:
                numbers = pending.pop(future)
                try:
                    yield from future.result()
                except BrokenProcessPool:
                    for number in numbers:
                        died = Result(name, number, "wrong: worker died or hung", "in this case or a neighbour")
                        yield MAKERS[name](seed, number), died
                    pool.shutdown(wait=False, cancel_futures=True)
                    chunks = iter([*pending.values(), *chunks])
                    pending.clear()
                    pool = ProcessPoolExecutor(workers, multiprocessing.get_context("spawn"), start_worker)
                    break
    finally:
        pool.shutdown(wait=False, cancel_futures=True)


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
    for r in (r for r in finished if r.detail):
        print(f"    case {r.number}: finer run gave up: {r.detail}")
    if name == "A":
        return wrong == 0 and len(finished) >= LEAST_SHARE * count
    return wrong == 0


def run_set(name: str, args: argparse.Namespace) -> tuple[list[Result], bool]:
    """Run one set; save failures of set A and wrong results. Return the results and whether all cases were run."""
    results: list[Result] = []
    start = time.perf_counter()
    try:
        for case, result in run_all(name, args.seed, args.count, args.workers):
            results.append(result)
            if result.outcome.startswith("wrong") or (name == "A" and result.outcome != "finished"):
                args.failures.mkdir(parents=True, exist_ok=True)
                save_case(case, result, args.failures / f"{name}_{case.seed}_{case.number:05d}.json")
            passed = time.perf_counter() - start
            bad = sum(r.outcome.startswith("wrong") for r in results)
            line = f"\rset {name}: {len(results)}/{args.count}, {bad} wrong, {passed:.0f} s"
            if sys.stderr.isatty() or len(results) % 100 == 0:
                print(line, end="", file=sys.stderr, flush=True)
    except KeyboardInterrupt:
        return results, False
    finally:
        print(file=sys.stderr)
    return results, True


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=10_000, help="cases of each set")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--set", dest="sets", choices=("A", "B", "AB"), default="AB")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--failures", type=Path, default=Path("stability_failures"), help="folder for failed cases")
    parser.add_argument("--replay", type=Path, help="run one saved case again")
    args = parser.parse_args()
    if args.replay:
        result = run_case(load_case(args.replay), finer=True)
        print("\n".join(f"{key:10} {value}" for key, value in asdict(result).items()))
        return int(result.outcome.startswith("wrong"))
    good = True
    for name in args.sets:
        results, complete = run_set(name, args)
        good &= report(name, results) and complete if results else False
        if not complete:
            print("stopped by the user")
            return 130
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
