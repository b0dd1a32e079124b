"""What the strokes can and cannot separate, from the covariance of a fit or of the point before it.

Conventions: everything in prior standard uncertainties, so that 1 is "nothing learnt". A direction among the asked
parameters, all others free, is undetermined where more than half of its prior standard uncertainty is left.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from validation.conventions import Array
from validation.identification.outcome.result import Combination

HALF = 0.5
CANNOT_TELL = "these strokes cannot tell the size of"
NAMED = 0.25  # of the largest weight: smaller ones are left out of the name


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
    values, vectors = np.linalg.eigh(0.5 * (covariance + covariance.T))
    undetermined: list[Combination] = []
    determined: list[Combination] = []
    for value, vector in sorted(zip(values, vectors.T, strict=True), key=lambda pair: -pair[0]):
        left = float(np.sqrt(max(value, 0.0)))
        (undetermined if left > HALF else determined).append(Combination(_weights(names, vector), left))
    return undetermined, determined


def _weights(names: Sequence[str], vector: Array) -> dict[str, float]:
    order = np.argsort(-np.abs(vector), kind="stable")
    lead = vector[order[0]]
    return {names[i]: float(vector[i] / lead) for i in order if abs(vector[i] / lead) >= NAMED}


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
