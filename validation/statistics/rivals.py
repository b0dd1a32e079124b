"""Is the model nearer than its rivals, stroke by stroke: a skill score against the best of them, with its interval.

Skill = 1 − error over error: 0.6 is an error 60 % smaller than that of the best rival, 0 as large, below 0 larger. The
errors are RMSE, the mean over strokes is that of their logarithms, so that no stroke counts more because it is harder.
Its 95 % interval is Student's t of the paired differences of the logarithms; it speaks for strokes like these.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.special import stdtrit

from validation.conventions import Array

FEWEST = 4
"""Strokes from which an interval is stated: with three Student's t is 4.3 and says nothing."""
LEAST = 1e-12
CALLED = {
    "null": "the null model",
    "unfitted": "the unfitted set",
    "regulated": "the unfitted set",
    "polynomial": "the polynomial",
    "fir": "the FIR filter",
}
"""Rivals in words; polynomial and FIR filter are the black boxes of `validation.prediction.black_boxes`."""


@dataclass(frozen=True)
class Skill:
    """Skill against the best rival, its 95 % interval (NaN with fewer than `FEWEST` strokes), and how many strokes."""

    rival: str
    skill: float
    low: float
    high: float
    strokes: int

    @property
    def words(self) -> str:
        """In a sentence's words."""
        size = f"{100 * abs(self.skill):.0f} % {'smaller' if self.skill >= 0 else 'larger'}"
        nearer = f"{size} than that of {CALLED.get(self.rival, self.rival)}"
        n = f"{self.strokes} stroke{'s' if self.strokes > 1 else ''}"
        inside = f"skill {self.skill:.2f}, 95 % {self.low:.2f} to {self.high:.2f}, {n}"
        return f"error {nearer} ({inside if np.isfinite(self.low) else f'skill {self.skill:.2f}; {n}: no interval'})"


def skill_of(model: Array, rivals: Mapping[str, Array]) -> Skill | None:
    """Skill of a model's errors (n,) against those of the rival that is best on the same strokes.

    Strokes that one of them has not are left out, a rival that has none altogether; None where nothing is left.
    """
    there = {name: np.asarray(of, dtype=float) for name, of in rivals.items() if np.isfinite(of).any()}
    known = np.isfinite(np.asarray(model, dtype=float)) & np.all([np.isfinite(of) for of in there.values()], axis=0)
    if not there or not known.any():
        return None
    size = {name: np.log(np.maximum(of[known], LEAST)) for name, of in there.items()}
    best = min(size, key=lambda name: float(size[name].mean()))
    ratio = np.log(np.maximum(np.asarray(model, dtype=float)[known], LEAST)) - size[best]
    n, mean = ratio.size, float(ratio.mean())
    reach = float(stdtrit(n - 1, 0.975) * ratio.std(ddof=1) / np.sqrt(n)) if n >= FEWEST else float("nan")
    low, high = 1.0 - np.exp(mean + reach), 1.0 - np.exp(mean - reach)
    return Skill(best, 1.0 - float(np.exp(mean)), float(low), float(high), n)
