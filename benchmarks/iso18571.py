"""Compare the ISO 18571-style score with the public package objective_rating_metrics: run time and agreement.

Prints, for curves without ties in the warping path and for curves with flat ends, the run times (best of several),
their ratio, and the largest difference of any of the five scores.  Exit code 1 if a target is missed: 20 ms,
100 times faster, 1e-9 without ties, 1e-3 with them.

    python -m benchmarks iso18571 [--samples 3500]
"""

from __future__ import annotations

import numpy as np
from objective_rating_metrics.rating import ISO18571

from benchmarks.runner import Run, Table, least
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


def theirs(test: np.ndarray, cae: np.ndarray) -> list[float]:
    axis = np.arange(test.size) * STEP
    rating = ISO18571(
        reference_curve=np.column_stack([axis, test]), comparison_curve=np.column_stack([axis, cae]), dt=STEP
    )
    return [getattr(rating, f"{name}_rating")(ndigits=15) for name in NAMES]


def main(run: Run) -> bool:
    """Print run times and differences; whether the targets are met."""
    short = without_ties(200)
    iso_score(*short, STEP), theirs(*short)  # compile both
    good, table = True, Table("curves:>13s", "ours ms:.1f", "package s:.2f", "ratio:.0f", "largest difference:.1e")
    for label, pair, allowed in (("without ties", without_ties, 1e-9), ("flat ends", with_ties, 1e-3)):
        curves = pair(run.samples)
        ours_s = least(lambda c=curves: iso_score(*c, STEP), 7)
        theirs_s = least(lambda c=curves: theirs(*c), run.turns)
        score = iso_score(*curves, STEP)
        off = max(abs(getattr(score, name) - value) for name, value in zip(NAMES, theirs(*curves), strict=True))
        good &= ours_s <= LIMIT_S and theirs_s >= FASTER * ours_s and off <= allowed
        table.row(label, 1e3 * ours_s, theirs_s, theirs_s / ours_s, off)
    run.figure("iso18571", f"{1e3 * ours_s:.1f} ms")
    print("wanted: at most 20 ms, at least 100 times faster, within 1e-9 without ties and 1e-3 otherwise")
    return good
