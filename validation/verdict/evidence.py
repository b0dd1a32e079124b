"""Evidence of a model from draws of its inputs: what two models of one session are compared by."""

from __future__ import annotations

import numpy as np
from scipy.special import gammaln

from validation.conventions import Array

MOST_NUMBERS = 9  # so that 199 draws tell their covariance well


def log_evidence(found: Array, drawn: Array, floor: Array) -> tuple[float, float]:
    """Natural logarithm of a model's evidence, the density that its ``drawn`` differences (N, d) give to those
    ``found`` (d,), and its standard uncertainty from the number of draws; ``floor`` (d,): least standard deviation. NaN
    with fewer than 3 d draws.

    The draws take parameters, force and sensors from what is declared of them, so that the density which they give to
    the data is the model's evidence (marginal likelihood, also called prior predictive density). Density: Student's t,
    which a normal one becomes where mean and covariance are known from N draws alone (Sellentin and Heavens 2016,
    MNRAS 456, L132); its logarithm is a proper score. The difference of two models on the same data is the logarithm of
    their Bayes factor. Uncertainty: jackknife over the draws.

    Parameters
    ----------
    found : (d,), mean differences of angles by channel and phase, rad; the first `MOST_NUMBERS` are taken
    drawn : (N, d), the same as drawn
    floor : (d,), smallest standard uncertainty of each, rad

    Returns
    -------
    tuple of float
        NaN where there are no data, or fewer than three draws a number.
    """
    found, drawn, floor = found[:MOST_NUMBERS], drawn[:, :MOST_NUMBERS], floor[:MOST_NUMBERS]
    if not found.size or len(drawn) < 3 * found.size:
        return float("nan"), float("nan")
    least = np.diag(floor**2)
    without = np.array([_log_density(found, np.delete(drawn, k, axis=0), least) for k in range(len(drawn))])
    u = float(np.sqrt((len(drawn) - 1) * without.var()))
    return _log_density(found, drawn, least), u


def _log_density(found: Array, drawn: Array, least: Array) -> float:
    """Natural logarithm of the density at ``found`` (d,) of the Student's t distribution that draws (N, d) predict;
    ``least`` (d, d) is added to their covariance."""
    n, d = drawn.shape
    free = n - d
    covariance = np.cov(drawn, rowvar=False).reshape(d, d) + least
    variances, axes = np.linalg.eigh(covariance * (n - 1.0) / free * (1.0 + 1.0 / n))
    variances = np.maximum(variances, d * np.finfo(float).eps * variances[-1])  # numbers that always move together
    away = (found - drawn.mean(axis=0)) @ axes / np.sqrt(variances)
    size = -0.5 * np.log(variances).sum() - 0.5 * d * np.log(np.pi * free)
    return float(gammaln(0.5 * n) - gammaln(0.5 * free) + size - 0.5 * n * np.log1p(away @ away / free))
