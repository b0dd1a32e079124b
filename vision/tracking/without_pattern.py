"""Find and take off a fixed pattern of the sensor, by as few fits as do.

A pattern is estimated from poses that it has spoilt, so it takes rounds: each refines the pattern by poses fitted less
that of the round before. The rounds fit only the rows the pattern is estimated from; the whole film is tracked again
when a pattern has been found that lets them fit better, and once more only where that found bodies in further rows.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from vision.reference.prepared_film import PreparedFilm
from vision.results.pose_table import PoseTable
from vision.tracking.film_tracker import FilmTracker
from vision.tracking.sensor_pattern import (
    BETTER,
    WithoutPattern,
    residual_variance,
    sampled_rows,
    sensor_pattern,
    suspected,
)
from vision.tracking.stretches import store

ROUNDS = 8
WORTH = 0.995
"""Residual variance of a round over that of the one before from which no further one is tried."""
TRACKED_AGAIN = 2
"""Times that the whole film is tracked again at most."""

Prepare = Callable[[WithoutPattern], PreparedFilm]
Pattern = NDArray[np.float32]


def pattern_by_sample(ready: PreparedFilm, table: PoseTable, prepare: Prepare) -> tuple[PreparedFilm, Pattern] | None:
    """The film less its pattern, prepared, and the pattern, (height, width); None where there is none whose removal
    fits the sampled rows better.

    ``ready`` may be the film less an earlier estimate; ``prepare`` makes templates of the film less another.
    """
    film = ready.film.film if isinstance(ready.film, WithoutPattern) else ready.film
    best: tuple[PreparedFilm, Pattern] | None = None
    sample = table.rows(sampled_rows(ready, table))
    before = residual_variance(ready, sample).mean()
    now = ready
    for _ in range(ROUNDS):
        pattern = sensor_pattern(film, now, sample)
        if pattern is None:
            break
        cleaned = prepare(WithoutPattern(film, pattern))
        again = fitted_from(cleaned, sample)
        after = residual_variance(cleaned, again).mean()
        first = best is None and now.film is film
        if again.failed.sum() > sample.failed.sum() or after > (BETTER * before if first else before):
            break
        best, settled = (cleaned, pattern), after > WORTH * before
        if settled:
            break
        now, sample, before = cleaned, again, after
    return best


def fitted_from(ready: PreparedFilm, table: PoseTable) -> PoseTable:
    """The rows of a table fitted again, each from its own poses; a body that is lost there stays lost."""
    tracker, again = FilmTracker(ready), PoseTable.empty(table.frame, len(ready.bodies))
    for row in range(table.frame.size):
        tracker.clear_histories()
        tracker.place(-1, table.pose[row])
        tracker.step(int(table.frame[row]), 0, search=False)
        store(tracker, again, row)
    return again


def pattern_is_suspected(ready: PreparedFilm, table: PoseTable) -> bool:
    """Whether residuals ask for a pattern and bodies have moved far enough to tell one."""
    return suspected(ready, table) and bool(sampled_rows(ready, table).size)


def better(before: tuple[PreparedFilm, PoseTable], after: tuple[PreparedFilm, PoseTable], is_first: bool) -> bool:
    """Whether tracking less the pattern has lost nothing and left smaller residuals, clearly so where it ``is_first``
    and finds no more."""
    found = int(before[1].failed.sum()) - int(after[1].failed.sum())
    old, new = (float(residual_variance(*of).mean()) for of in (before, after))
    return found >= 0 and new <= (BETTER * old if is_first and not found else old)
