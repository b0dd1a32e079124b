"""Skill of a model beside its rivals, stroke by stroke: a score against the best of them, its interval, and words.

Skill = 1 − error over error: 0.6 is an error 60 % smaller than that of the best rival, 0 as large, below 0 larger. The
errors are RMSE, the mean over strokes is that of their logarithms, so that no stroke counts more because it is harder.
Its 95 % interval is Student's t of the paired differences of the logarithms; it speaks for strokes like these.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy.special import stdtrit

from validation.conventions import LEVEL, Array
from validation.measurement.trial import trials_in_words

RIVALS = ("null", "unfitted", "polynomial", "fir", "fir_lags")
FEWEST = 4
"""Strokes from which an interval is stated: with three Student's t is 4.3 and says nothing."""
LEAST = 1e-12  # of an error, so that its logarithm exists
CALLED = {
    "null": "the null model",
    "unfitted": "the values before the fit",
    "polynomial": "the polynomial",
    "fir": "the FIR filter",
    "fir_lags": "the FIR filter of six lags",
}
"""Rivals in words; polynomial and FIR filters are the black boxes of `validation.prediction.black_boxes`."""


@dataclass(frozen=True)
class Skill:
    """Skill against the best rival, its 95 % interval (NaN with fewer than `FEWEST` strokes), and how many strokes."""

    rival: str
    skill: float
    low: float
    high: float
    strokes: int

    @property
    def interval(self) -> str:
        """Its interval in brackets; empty where there is none."""
        return f" [{self.low:.2f}, {self.high:.2f}]".replace("-", "−") if np.isfinite(self.low) else ""

    @property
    def words(self) -> str:
        size = f"{100 * abs(self.skill):.0f} % {'smaller' if self.skill >= 0 else 'larger'}"
        nearer = f"{size} than that of {CALLED.get(self.rival, self.rival)}"
        n = f"{self.strokes} stroke{'s' if self.strokes > 1 else ''}"
        skill = f"{self.skill:.2f}".replace("-", "−")
        return f"error {nearer} (skill {skill}{self.interval}; {n}{'' if self.interval else ': no interval'})"


def compute_skill(model: Array, rivals: Mapping[str, Array]) -> Skill | None:
    """Skill, 1 - error over error (geometric means), of a model's errors (n,), not negative (as RMSE), against the
    rival with the least; ``rivals``: such errors (n,) by name, NaN where a stroke has none. None where nothing
    compares.

    Strokes that one of them has not are left out, a rival that has none altogether.
    """
    there = {name: np.asarray(of, dtype=float) for name, of in rivals.items() if np.isfinite(of).any()}
    known = np.isfinite(np.asarray(model, dtype=float)) & np.all([np.isfinite(of) for of in there.values()], axis=0)
    if not there or not known.any():
        return None
    size = {name: np.log(np.maximum(of[known], LEAST)) for name, of in there.items()}
    best = min(size, key=lambda name: float(size[name].mean()))
    ratio = np.log(np.maximum(np.asarray(model, dtype=float)[known], LEAST)) - size[best]
    n, mean = ratio.size, float(ratio.mean())
    reach = float(stdtrit(n - 1, 1.0 - LEVEL / 2.0) * ratio.std(ddof=1) / np.sqrt(n)) if n >= FEWEST else float("nan")
    low, high = 1.0 - np.exp(mean + reach), 1.0 - np.exp(mean - reach)
    return Skill(best, 1.0 - float(np.exp(mean)), float(low), float(high), n)


def describe_skills(skill: Mapping[str, Skill], fitted: str) -> tuple[str, ...]:
    """One sentence, in a tuple, on the skills by channel with their intervals and best rivals; empty without skills.
    ``fitted``: text that says what the black boxes were fitted to."""
    if not skill:
        return ()
    of = []
    for channel, one in skill.items():
        n = "" if one.interval else f"; {one.strokes} trial{'s' if one.strokes > 1 else ''}: no interval"
        size = f"{one.skill:.2f}".replace("-", "−")
        of.append(f"{channel} {size}{one.interval} ({CALLED[one.rival].removeprefix('the ')}{n})")
    rivals = f"null model, values before the fit, black boxes fitted to {fitted}"
    return (f"Skill, 1 − RMSE over that of the best rival ({rivals}): {', '.join(of)}.",)


def describe_nearer_rivals(skill: Mapping[str, Skill]) -> str:
    """Sentence on rivals whose error is smaller than the model's, by channel, with the interval; empty where no channel
    has one."""
    parts = []
    for channel, one in skill.items():
        if one.skill >= 0.0:
            continue
        strokes = f"{one.strokes} stroke{'s' if one.strokes > 1 else ''}"
        known = f"95 % interval {1 - one.high:.2g} to {1 - one.low:.2g}, {strokes}"
        times = f"{1 - one.skill:.2g} times as large"
        parts.append(
            f"{channel} {CALLED[one.rival]} (the model's error is {times}; "
            f"{known if np.isfinite(one.low) else f'of {strokes} no interval'})"
        )
    return f"Nearer than the model: in {'; in '.join(parts)}." if parts else ""


def describe_nearest(errors: pd.DataFrame) -> list[str]:
    """One line, in a list, on which of the model and its rivals is nearest to each trial, by channel; ``errors``: a row
    a trial and channel with its ``nearest``, empty where nothing is known. Empty list where no row has one."""
    parts = []
    for channel, part in errors[errors["nearest"] != ""].groupby("channel", sort=False):
        by_name: dict[str, list[int]] = {}
        for row in part.itertuples():
            by_name.setdefault(str(row.nearest), []).append(int(row.trial))
        named = [f"{CALLED.get(name, f'the {name}')} ({trials_in_words(of)})" for name, of in by_name.items()]
        parts.append(f"{channel} {', '.join(named)}")
    return [f"Nearest: {'; '.join(parts)}."] if parts else []
