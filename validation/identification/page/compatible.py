"""Which part of the model explains the difference: every smallest set of laws that is compatible with the strokes.

A set of laws explains them if all other laws may be as they were before: its evidence beside that of all laws free is
the ratio of posterior to prior density at "the others have not changed" (Savage and Dickey; the fit's own Gaussian).
Sets of one, two and three laws are looked at. Named are all sets of the smallest size that is as good as any larger one
to a factor of `ODDS`, each with the change it would take: never one where several do. None is named where the fit did
not settle or the model lacks something that no law makes up for (docs/decisions/0165-which-part-explains.md).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from validation.conventions import Array
from validation.identification.estimates import LACKING
from validation.identification.fit import Fitted
from validation.identification.problem import Problem
from validation.identification.scatter import lacking

ODDS = 20.0
MOST_LAWS = 3
FOLLOWED = 12  # laws of the best pairs that are tried as thirds, and so on
MOST_NAMED = 6


@dataclass(frozen=True)
class Change:
    """What one law would have changed by, in prior standard uncertainties."""

    name: str
    z: float
    z_u: float


@dataclass(frozen=True)
class Explanation:
    """What explains the difference.

    Attributes
    ----------
    sets : sets of changes, each enough by itself; empty where ``why_none`` says why
    size : how many laws each of them has; 0 where nothing need have changed
    why_none : why no set is named
    more : sets that are compatible, too, and are not listed
    """

    sets: tuple[tuple[Change, ...], ...]
    size: int
    why_none: str = ""
    more: int = 0


def explain_fit(problem: Problem, fitted: Fitted) -> Explanation:
    """`explain` for a fit: all laws that it moved, asked for or not.

    None is named where the fit did not settle, or where the trials differ from it alike by more than a law can do.
    """
    if not fitted.converged:
        return Explanation((), 0, "the fit did not settle")
    share = lacking(fitted)
    if share > LACKING:
        return Explanation(
            (), 0, f"trials differ from the model alike by {100 * share:.0f} % of what all its laws together could do"
        )
    laws = [j for j, p in enumerate(problem.unknowns.moved) if p.factor or p in problem.unknowns.asked]
    covariance = fitted.covariance[np.ix_(laws, laws)]
    return explain([problem.unknowns.moved[j].name for j in laws], fitted.z[laws], covariance)


def in_words(found: Explanation, problem: Problem) -> str:
    """The explanation as a sentence."""
    if found.why_none:
        return f"None of its parts explains the difference between model and strokes: {found.why_none}."
    if found.size == 0:
        return "Nothing need have changed: the strokes agree with the values before, within what was known of them."
    moved = {p.name: p for p in problem.unknowns.moved}

    def words(change: Change) -> str:
        p = moved[change.name]
        before, after = (p.physical(problem.action, z) for z in (0.0, change.z))
        u = p.u * change.z_u
        if p.factor:
            return f"{change.name} × {after / before:.3g} (u {100 * u:.2g} %)"
        return f"{change.name} {after - before:+.2g} {p.unit(problem.action)} (u {u:.1g})"

    listed = "; ".join(" with ".join(words(c) for c in one) for one in found.sets)
    further = f"; and {found.more} more" if found.more else ""
    if len(found.sets) + found.more == 1:
        alone = "One change explains" if found.size == 1 else f"{found.size} changes together explain"
        return f"{alone} the difference between model and strokes: {listed}."
    each = "Each of these changes alone" if found.size == 1 else f"Each of these sets of {found.size} changes"
    return f"{each} explains the difference between model and strokes, which cannot tell them apart: {listed}{further}."


def explain(names: Sequence[str], z: Array, covariance: Array) -> Explanation:
    """Smallest sets of laws compatible with the strokes.

    Parameters
    ----------
    names : (p,) of the laws
    z : (p,) most probable values, in prior standard uncertainties from the prior's
    covariance : (p, p) of z, all else taken out
    """
    p = len(names)
    every = frozenset(range(p))
    scores: dict[int, dict[frozenset[int], float]] = {0: {frozenset(): log_odds(z, covariance, every)}}
    best_laws = list(range(p))
    for size in range(1, min(MOST_LAWS, p) + 1):
        found = {
            frozenset(s): log_odds(z, covariance, every - frozenset(s)) for s in combinations(sorted(best_laws), size)
        }
        scores[size] = found
        best_laws = _members(found)
    largest = max(max(max(found.values()) for found in scores.values()), 0.0)  # 0: all laws free
    for size, found in scores.items():
        if max(found.values()) < largest - math.log(ODDS):
            continue
        top = max(found.values())
        near = sorted((s for s, v in found.items() if v >= top - math.log(ODDS)), key=lambda s: -found[s])
        sets = tuple(_changes(names, z, covariance, s) for s in near[:MOST_NAMED] if s)
        return Explanation(sets, size, more=len(near) - min(len(near), MOST_NAMED))
    return Explanation((), 0, f"more than {MOST_LAWS} laws must have changed together; the values are in the table")


def log_odds(z: Array, covariance: Array, unchanged: frozenset[int]) -> float:
    """Log of the evidence that these laws have not changed, beside that of all laws free."""
    if not unchanged:
        return 0.0
    at = sorted(unchanged)
    inside = covariance[np.ix_(at, at)]
    return -0.5 * (float(z[at] @ np.linalg.solve(inside, z[at])) + float(np.linalg.slogdet(inside)[1]))


def _members(found: dict[frozenset[int], float]) -> list[int]:
    """Laws of the best sets, the best first, so many as are followed."""
    out: dict[int, None] = {}
    for one in sorted(found, key=lambda s: -found[s]):
        out |= dict.fromkeys(one)
        if len(out) >= FOLLOWED:
            break
    return list(out)[:FOLLOWED]


def _changes(names: Sequence[str], z: Array, covariance: Array, moved: frozenset[int]) -> tuple[Change, ...]:
    """Change of each law of a set where all others have not changed."""
    inside: NDArray[np.intp] = np.array(sorted(moved))
    others = np.array([i for i in range(len(names)) if i not in moved], dtype=int)
    mean, spread = z[inside], covariance[np.ix_(inside, inside)]
    if others.size:
        gain = np.linalg.solve(covariance[np.ix_(others, others)], covariance[np.ix_(others, inside)]).T
        mean = mean - gain @ z[others]
        spread = spread - gain @ covariance[np.ix_(others, inside)]
    return tuple(
        Change(names[i], float(m), float(math.sqrt(max(s, 0.0))))
        for i, m, s in zip(inside, mean, np.diag(spread), strict=True)
    )
