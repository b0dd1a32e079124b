"""Conditions of a session: the trials whose errors may be pooled.

A change within the session is a step of a primary quantity's error between two trials: the distance of the means before
and after over the scatter within both, Student's t of n − 2 degrees of freedom, beyond the value that one of all
quantities and places exceeds in a session in a thousand (Bonferroni). A drift is no step: a straight line must leave
more scatter. Of several steps in a session the largest must stand out, else none is found.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.special import stdtrit

from validation.conventions import Array
from validation.verdict.error_draws import TrialErrors
from validation.verdict.quantities import IS_PRIMARY, QUANTITIES, Quantity, quantity_limits

FEWEST_IN_PART = 2  # trials, so that one odd trial is no change
LEVEL = 1e-3  # of a session without a change
LEAST = 0.1  # of the limit of relevance: less hardly moves an interval


@dataclass(frozen=True)
class Change:
    """A step of a quantity's error."""

    first: int  # number of the first trial after it
    last: int  # of the last before it
    quantity: Quantity
    size: float  # in the quantity's SI unit
    deviations: float  # size over its standard deviation from the scatter
    limit: float  # of ``deviations``


def separate_conditions(
    numbers: Sequence[int], conditions: Sequence[Collection[int]], firsts: Collection[int]
) -> tuple[tuple[int, ...], ...]:
    """Trial numbers of each condition: of the ``conditions`` seen (all ``numbers`` where there are none), each cut
    before the trials ``firsts`` from which on something changed; empty where only one results.

    Parameters
    ----------
    numbers : of all trials
    conditions : trials of each that was seen, where there are several
    firsts : first trials of what changed
    """
    out = []
    for members in conditions or [numbers]:
        cuts = [0, *sorted(first for first in firsts if first in members and first > min(members)), float("inf")]
        out += [tuple(sorted(n for n in members if low <= n < high)) for low, high in pairwise(cuts)]
    return tuple(out) if len(out) > 1 else ()


def find_change(found: Mapping[int, TrialErrors], limits: Mapping[str, float]) -> Change | None:
    """Largest step, between two trials in order of their number, of a primary quantity's error beyond the trials'
    scatter; ``found``: errors by trial number, ``limits``: limits of relevance by name. None if none, or with fewer
    than 4 trials on one branch."""
    most = Counter(one.branch for one in found.values()).most_common(1)
    numbers = sorted(n for n in found if found[n].branch == most[0][0])
    n = len(numbers)
    places = range(FEWEST_IN_PART, n - FEWEST_IN_PART + 1)
    if not places:
        return None
    errors = np.array([found[number].errors for number in numbers])
    tested = np.flatnonzero(IS_PRIMARY & np.isfinite(errors).all(axis=0))
    if not tested.size:
        return None
    relevant = np.mean([quantity_limits(limits, found[i].travel, found[i].values) for i in numbers], axis=0)[tested]
    errors = errors[:, tested]
    line = _scatter(errors, np.arange(float(n)))
    best: tuple[float, int, int, float] = (0.0, 0, 0, 0.0)
    for k in places:
        step = np.arange(n) >= k
        within, apart = _scatter(errors, step.astype(float)), errors[step].mean(axis=0) - errors[~step].mean(axis=0)
        deviations = np.abs(apart) / np.maximum(within * np.sqrt(1 / k + 1 / (n - k)), np.finfo(float).tiny)
        deviations[(np.abs(apart) < LEAST * relevant) | (within >= line)] = 0.0
        i = int(np.argmax(deviations))
        best = max(best, (float(deviations[i]), k, i, float(apart[i])))
    deviation, k, i, apart_i = best
    limit = float(stdtrit(n - 2, 1.0 - 0.5 * LEVEL / (len(places) * tested.size)))
    if deviation < limit:
        return None
    return Change(numbers[k], numbers[k - 1], QUANTITIES[tested[i]], apart_i, deviation, limit)


def _scatter(errors: Array, of_trial: Array) -> Array:
    """Standard deviation of errors (n, V) about what is linear in a number of each trial (n,), (V,)."""
    design = np.column_stack([np.ones(len(errors)), of_trial])
    left = errors - design @ np.linalg.lstsq(design, errors, rcond=None)[0]
    return np.asarray(np.sqrt((left**2).sum(axis=0) / (len(errors) - 2)))
