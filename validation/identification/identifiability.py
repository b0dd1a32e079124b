"""What the strokes can and cannot separate, from the covariance of a fit or of the point before it.

Conventions: everything in prior standard uncertainties, so that 1 is "nothing learnt". A direction among the asked
parameters, all others free, is undetermined where more than half of its prior standard uncertainty is left.

Undetermined directions that are known equally badly mix in any set of eigenvectors, and a mixture of ten names tells
nothing. They are taken apart into directions of few names: each has one name of its own (echelon form of the
undetermined space, pivots by QR), and keeps only as many others as it needs to stay undetermined by itself.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.linalg import qr

from validation.conventions import Array
from validation.identification.outcome.result import Combination

HALF = 0.5
CANNOT_TELL = "these strokes cannot tell the size of"
NAMED = 0.25  # of the largest weight: smaller ones are left out of the name where it holds without them


def directions(names: Sequence[str], covariance: Array) -> tuple[list[Combination], list[Combination]]:
    """Undetermined and determined directions among parameters, each from the least known to the best known.

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
    values, vectors = np.linalg.eigh(cov)
    left = np.sqrt(np.maximum(values, 0.0))
    precision = np.asarray(np.linalg.inv(cov), dtype=float)
    undetermined = []
    for vector in _taken_apart(np.asarray(vectors[:, left > HALF], dtype=float)):
        short = _shortest(vector, precision)
        undetermined.append(Combination(_weights(names, short, 0.0), _left(short, precision)))
    determined = [
        Combination(_weights(names, vectors[:, i], NAMED), float(left[i]))
        for i in np.argsort(-left, kind="stable")
        if left[i] <= HALF
    ]
    return sorted(undetermined, key=lambda d: -d.left), determined


def _taken_apart(space: Array) -> list[Array]:
    """Vectors (n,) that span the columns (n, k), each with one component that no other has."""
    if space.shape[1] == 0:
        return []
    _, _, order = qr(space.T, pivoting=True, mode="economic")
    own = order[: space.shape[1]]
    return list(np.linalg.solve(space[own].T, space.T))


def _left(vector: Array, precision: Array) -> float:
    """Share of the prior standard uncertainty that is left along a vector, all other directions held."""
    return float(np.sqrt(vector @ vector / (vector @ precision @ vector)))


def _shortest(vector: Array, precision: Array) -> Array:
    """The vector with its largest components only, as few as leave it undetermined."""
    order = np.argsort(-np.abs(vector), kind="stable")
    short = np.zeros_like(vector)
    for i in order:
        short[i] = vector[i]
        if _left(short, precision) > HALF and np.abs(vector[short == 0.0]).max(initial=0.0) < NAMED:
            break
    return short


def _weights(names: Sequence[str], vector: Array, least: float) -> dict[str, float]:
    order = np.argsort(-np.abs(vector), kind="stable")
    share = vector / vector[order[0]]
    return {names[i]: float(share[i]) for i in order if share[i] != 0.0 and abs(share[i]) >= least}


def warnings_of(names: Sequence[str], covariance: Array) -> list[str]:
    """Sentences on what these strokes cannot separate; none where every asked parameter is determined."""
    width = np.sqrt(np.diag(covariance))
    poor = [(n, w) for n, w in zip(names, width, strict=True) if w > HALF]
    said = []
    if poor:
        listed = ", ".join(f"{n} ({100 * w:.0f} % of its prior u left)" for n, w in poor)
        said.append(f"these strokes say little of {listed}")
    undetermined, _ = directions(names, covariance)
    said += [
        f"{CANNOT_TELL} {d.words} ({100 * d.left:.0f} % of its prior u left)"
        for d in undetermined
        if len(d.weights) > 1
    ]
    return said
