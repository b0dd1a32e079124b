"""Compare the ISO 18571-style score with the public package objective_rating_metrics: run time and agreement.

Prints, for curves without ties in the warping path and for curves with flat ends, the run times (best of several),
their ratio, and the largest difference of any of the five scores.  Exit code 1 if a target is missed: 20 ms,
100 times faster, 1e-9 without ties, 1e-3 with them.

Run:  python benchmarks/iso18571.py [--samples 3500]
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable

import numpy as np
from objective_rating_metrics.rating import ISO18571

from validation.scores.iso18571 import iso_score

STEP = 1e-4
LIMIT_S, FASTER = 0.020, 100.0
NAMES = ("corridor", "phase", "magnitude", "slope", "overall")


def without_ties(n: int) -> tuple[np.ndarray, np.ndarray]:
    """A blow-like noisy curve, and a late, larger prediction with its own noise."""
    rng = np.random.default_rng(18571)
    t = np.arange(n) / n

    def curve(late: float, size: float) -> np.ndarray:
        s = t - late
        return size * (np.tanh((s - 0.2) / 0.02) - np.tanh((s - 0.7) / 0.05) + 0.2 * np.sin(40 * s) * np.exp(-3 * s))

    return curve(0.0, 1.0) + 1e-4 * rng.normal(size=n), curve(0.004, 1.05) + 1e-4 * rng.normal(size=n)


def with_ties(n: int) -> tuple[np.ndarray, np.ndarray]:
    """The same curves with ends that are exactly zero."""
    test, cae = without_ties(n)
    for curve in (test, cae):
        curve[: n // 10] = curve[-n // 5 :] = 0.0
    return test, cae


def best(run: Callable[[], object], times: int) -> float:
    found = []
    for _ in range(times):
        start = time.perf_counter()
        run()
        found.append(time.perf_counter() - start)
    return min(found)


def theirs(test: np.ndarray, cae: np.ndarray) -> list[float]:
    axis = np.arange(test.size) * STEP
    rating = ISO18571(
        reference_curve=np.column_stack([axis, test]), comparison_curve=np.column_stack([axis, cae]), dt=STEP
    )
    return [getattr(rating, f"{name}_rating")(ndigits=15) for name in NAMES]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--samples", type=int, default=3500)
    n = parser.parse_args().samples
    short = without_ties(200)
    iso_score(*short, STEP), theirs(*short)  # compile both
    good = True
    print(f"{'curves':>13} {'ours':>9} {'package':>9} {'ratio':>6} {'largest difference':>19}")
    for label, pair, allowed in (("without ties", without_ties(n), 1e-9), ("flat ends", with_ties(n), 1e-3)):
        ours_s, theirs_s = best(lambda p=pair: iso_score(*p, STEP), 7), best(lambda p=pair: theirs(*p), 2)
        score = iso_score(*pair, STEP)
        off = max(abs(getattr(score, name) - value) for name, value in zip(NAMES, theirs(*pair), strict=True))
        good &= ours_s <= LIMIT_S and theirs_s >= FASTER * ours_s and off <= allowed
        print(f"{label:>13} {1e3 * ours_s:6.1f} ms {theirs_s:7.2f} s {theirs_s / ours_s:6.0f} {off:19.1e}")
    print(f"N = {n}; wanted: at most 20 ms, at least 100 times faster, within 1e-9 without ties and 1e-3 otherwise")
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
