"""The one fit of mains hum: a level at rest and three harmonics, least squares over the samples at rest.

What is subtracted is continued over the whole record, so that a stroke is never filtered. Time in s, any unit of the
reading. Where hum must first be shown to be there: `rig.session.force_correction.fit_hum`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
HARMONICS = 3  # of the mains: choice; rectifiers make odd ones
SEARCH_HZ = 0.2  # largest steady deviation from 50 Hz that Europe's grid code allows


class MainsHum(NamedTuple):
    """What the samples at rest say of a record of n samples."""

    rest: Array
    """(n,) the level, as the terms of rest continue it."""
    hum: Array
    """(n,) the sinusoids."""
    residual: Array
    """Of the samples at rest."""
    frequency_hz: float
    u: Array
    """(n,) standard uncertainty of level and hum together, of independent readings."""


def hum_terms(time_s: Array, mains_hz: float) -> Array:
    """Columns (n, 6) cos, sin at one, two and three times ``mains_hz``, Hz, at times (n,), s: the terms of a linear
    fit."""
    turn = 2.0 * np.pi * mains_hz * time_s
    first = np.cos(turn) + 1j * np.sin(turn)
    columns, harmonic = [], first
    for k in range(1, HARMONICS + 1):  # by products: sines cost most of a trial's correction
        columns += [harmonic.real, harmonic.imag]
        harmonic = harmonic * first if k < HARMONICS else harmonic
    return np.column_stack(columns)


def fit_mains_hum(
    time_s: Array, reading: Array, at_rest: NDArray[np.bool_], frequencies_hz: Array, rest_terms: Array | None = None
) -> MainsHum:
    """Fit level and three harmonics of the mains by least squares to the samples where ``at_rest`` is true, at that of
    ``frequencies_hz`` which leaves the least, and continue both over all samples; ``rest_terms`` (n, m) replace the
    level.

    Parameters
    ----------
    time_s, reading : (n,)
    at_rest : (n,) the samples that are fitted
    frequencies_hz : (k,) mains frequencies that may be
    rest_terms : (n, m) what the reading is at rest beside hum; by default one level
    """
    level = np.ones((time_s.size, 1)) if rest_terms is None else rest_terms
    best: tuple[float, float, Array, Array] | None = None
    for mains_hz in np.atleast_1d(frequencies_hz).tolist():
        terms = np.column_stack([level, hum_terms(time_s, mains_hz)])
        found = np.asarray(np.linalg.lstsq(terms[at_rest], reading[at_rest], rcond=None)[0], dtype=float)
        left = reading[at_rest] - terms[at_rest] @ found
        if best is None or float(left @ left) < best[0]:
            best = float(left @ left), mains_hz, terms, found
    assert best is not None
    cost, frequency_hz, terms, found = best
    still, m = terms[at_rest], level.shape[1]
    inverse = np.linalg.pinv(still.T @ still) * cost / max(len(still) - found.size, 1)
    return MainsHum(
        rest=terms[:, :m] @ found[:m],
        hum=terms[:, m:] @ found[m:],
        residual=reading[at_rest] - still @ found,
        frequency_hz=frequency_hz,
        u=np.sqrt(np.einsum("ij,jk,ik->i", terms, inverse, terms)),
    )
