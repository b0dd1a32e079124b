"""What the strokes can and cannot separate, from the covariance of a fit or of the point before it.

Conventions: everything in prior standard uncertainties, so that 1 is "nothing learnt". A direction among the asked
parameters, all others free, is undetermined where more than half of its prior standard uncertainty is left.

Undetermined directions that are known equally badly mix in any set of eigenvectors, and a mixture of ten names tells
nothing. They are taken apart into directions of few names: each has one name of its own (echelon form of the
undetermined space, pivots by QR), and keeps only as many others as it needs to stay undetermined by itself.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import qr

from validation.conventions import Array
from validation.prediction.posterior import order_by_size, principal_axes


@dataclass(frozen=True)
class Combination:
    """A direction among the asked parameters: names with weights (largest 1), and the share of the prior left."""

    weights: Mapping[str, float]
    left: float

    @property
    def words(self) -> str:
        """Text of the direction, such as ``a + 0.6 × b − 0.03 × c``."""
        text = ""
        for i, (name, w) in enumerate(self.weights.items()):
            sign = ("−" if w < 0 else "") if i == 0 else (" − " if w < 0 else " + ")
            digits = ".1f" if abs(w) >= 0.095 else ".1g"  # from what rounds to 0.1 on
            # what rounds to 1.0 needs no size
            size = "" if abs(abs(w) - 1.0) < 0.05 else f"{abs(w):{digits}} × "
            text += f"{sign}{size}{name}"
        return text


HALF = 0.5  # share of the prior standard deviation left: more is hardly told by the strokes
CANNOT_TELL = "these strokes cannot tell the size of"
NAMED = 0.25  # of the largest weight: smaller ones are left out of the name where it holds without them
EXPECTED = 0.05
"""Discrepancy that is expected of a model before the strokes are looked at, of the size of the response."""
NEARLY = 1.2  # of the share left along an eigenvector: what is named of it must be known as well


def directions(names: Sequence[str], covariance: Array) -> tuple[list[Combination], list[Combination]]:
    """Directions in the space of z along which over half of the prior's u is left (undetermined), and the others
    (determined), each list by the share left, the largest first; ``covariance`` (n, n): of z, in prior standard
    uncertainties.

    Parameters
    ----------
    names : of the parameters
    covariance : (n, n) of z

    Returns
    -------
    undetermined, determined : lists of Combination
        A direction of one parameter alone is among them, too.
    """
    cov = 0.5 * (covariance + covariance.T)
    values, vectors = principal_axes(cov)
    left = np.sqrt(np.maximum(values, 0.0))
    precision = np.asarray(np.linalg.inv(cov), dtype=float)
    undetermined = []
    for vector in _sparse_basis(np.asarray(vectors[:, left > HALF], dtype=float)):
        short = _shorten_undetermined(vector, precision)
        undetermined.append(Combination(_name_weights(names, short), _share_left_conditional(short, precision)))
    determined = []
    for i in np.argsort(-left, kind="stable"):
        if left[i] <= HALF:
            named = _keep_determined(np.asarray(vectors[:, i], dtype=float), cov, float(left[i]))
            determined.append(Combination(_name_weights(names, named), _share_left_marginal(named, cov)))
    return sorted(undetermined, key=lambda d: -d.left), determined


def _sparse_basis(space: Array) -> list[Array]:
    """Vectors (n,) that span the columns (n, k), each with one component that no other has."""
    if space.shape[1] == 0:
        return []
    _, _, order = qr(space.T, pivoting=True, mode="economic")
    own = order[: space.shape[1]]
    return list(np.linalg.solve(space[own].T, space.T))


def _share_left_conditional(vector: Array, precision: Array) -> float:
    """Share of the prior standard uncertainty that is left along a vector, all other directions held."""
    return float(np.sqrt(vector @ vector / (vector @ precision @ vector)))


def _share_left_marginal(vector: Array, covariance: Array) -> float:
    """Share of the prior standard uncertainty that is left along a vector, all other directions free."""
    return float(np.sqrt(vector @ covariance @ vector / (vector @ vector)))


def _keep_determined(vector: Array, covariance: Array, share_left: float) -> Array:
    """Copy of the direction ``vector`` (n,) with small components zero: the fewest, largest ones along which no more
    than `NEARLY` times ``share_left`` of the prior's u is left, all other directions free; ``covariance`` (n, n): of z.
    """
    order = order_by_size(vector)
    short = np.zeros_like(vector)
    for i in order:
        short[i] = vector[i]
        dropped = np.abs(vector[short == 0.0]).max(initial=0.0)
        near = _share_left_marginal(short, covariance) <= min(NEARLY * share_left, HALF)
        if near and dropped < NAMED * abs(vector[order[0]]):
            break
    return short


def _shorten_undetermined(vector: Array, precision: Array) -> Array:
    """Copy of the direction ``vector`` (n,) with small components zero: the fewest, largest ones along which over half
    of the prior's u is left, all other directions held; ``precision`` (n, n): inverse covariance of z."""
    order = order_by_size(vector)
    short = np.zeros_like(vector)
    for i in order:
        short[i] = vector[i]
        if _share_left_conditional(short, precision) > HALF and np.abs(vector[short == 0.0]).max(initial=0.0) < NAMED:
            break
    return short


def _name_weights(names: Sequence[str], vector: Array) -> dict[str, float]:
    order = order_by_size(vector)
    share = vector / vector[order[0]]
    return {names[i]: float(share[i]) for i in order if share[i] != 0.0}


def warnings_of(names: Sequence[str], covariance: Array) -> list[str]:
    """Sentences on the parameters ``names``, and on their combinations, of which over half of the prior's u is left;
    empty where there are none. ``covariance`` (n, n): of z, in prior standard uncertainties."""
    width = np.sqrt(np.diag(covariance))
    poor = [(n, w) for n, w in zip(names, width, strict=True) if w > HALF]
    said = []
    if poor:
        listed = ", ".join(f"{n} ({100 * w:.0f} % of its prior uncertainty left)" for n, w in poor)
        said.append(f"these strokes say little of {listed}")
    undetermined, _ = directions(names, covariance)
    said += [
        f"{CANNOT_TELL} {d.words} ({100 * d.left:.0f} % of its prior uncertainty left)"
        for d in undetermined
        if len(d.weights) > 1
    ]
    return said


def warnings_before(names: Sequence[str], at_best: Array, expected: Array) -> list[str]:
    """Sentences before a fit on parameters of which over half of the prior's u will be left; ``at_best``, ``expected``:
    covariances (n, n) of z if the model lacks nothing, and with a usual discrepancy.

    Parameters
    ----------
    names : of the parameters
    at_best : (n, n) covariance if the model lacked nothing
    expected : (n, n) covariance if it lacks as much as is expected of one
    """
    said = [f"even if the model lacks nothing, {line}" for line in warnings_of(names, at_best)]
    best, usual = (np.sqrt(np.diag(c)) for c in (at_best, expected))
    more = [f"{n} ({100 * w:.0f} %)" for n, b, w in zip(names, best, usual, strict=True) if b <= HALF < w]
    if more:
        said.append(
            f"if the model lacks {100 * EXPECTED:.0f} % of what all its laws together could do, these strokes say "
            f"little of {', '.join(more)}, too (of the prior uncertainty left)"
        )
    return said
