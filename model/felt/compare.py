"""Which laws the presses support: each law is judged on every press by parameters fitted to the others.

A law is ruled out when it is farther from presses it was not fitted to than the best law is, by more than chance: an
exact sign-flip test over presses of the logarithm of the misfits' ratio, Holm's rule over the laws. With fewer than six
presses no law can be ruled out at 5 %, and the result says so.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from model.arrays import ArrayRecord
from model.errors import InputError
from model.felt.fit import LawFit, fit_law, root_mean_square, shares
from model.felt.laws_as_numbers import LAWS
from model.felt.pressing import Pressing
from model.sign_flip_test import LEVEL, sign_flip_p

ALIKE = 1.05  # ratio of misfits below which a law is as good in practice, whatever the test finds

Array = NDArray[np.float64]


@dataclass(frozen=True)
class LawComparison(ArrayRecord):
    """All laws on presses they were not fitted to.

    Attributes
    ----------
    presses : names, (m,)
    fits : one for each law
    held_out : (k, m) misfit of each law on each press, as a share of its peak force
    noise : (m,) the force's own noise as a share of the peak: no law can be nearer
    p_value : (k,) that the best law is nearer by chance, after Holm; 1 for the best
    supported : laws that are not ruled out, best first
    """

    presses: tuple[str, ...]
    fits: tuple[LawFit, ...]
    held_out: Array
    noise: Array
    p_value: Array
    supported: tuple[str, ...]

    @property
    def overall(self) -> Array:
        """(k,) typical misfit of each law: the geometric mean over presses."""
        return np.asarray(np.exp(np.mean(np.log(self.held_out), axis=1)), dtype=float)

    @property
    def least_p(self) -> float:
        """Least p-value that so many presses can give a single pair of laws."""
        return 2.0 ** (1 - len(self.presses))

    @property
    def verdict(self) -> str:
        """One sentence."""
        if (len(self.fits) - 1) * self.least_p > LEVEL:
            best = self.fits[int(np.argmin(self.overall))].kind
            return (
                f"{len(self.presses)} presses cannot tell the laws apart (nearest: {best}); "
                f"record at least {_enough(len(self.fits) - 1)}, at other speeds and peak forces"
            )
        if len(self.supported) == len(self.fits):
            return f"the presses do not tell which law holds; nearest is {self.supported[0]}"
        out = [fit.kind for fit in self.fits if fit.kind not in self.supported]
        return f"the presses support {' or '.join(self.supported)}, and speak against {' and '.join(out)}"


def _enough(pairs: int) -> int:
    """Presses needed so that the nearest of several laws can be claimed."""
    n = 2
    while pairs * 2.0 ** (1 - n) > LEVEL:
        n += 1
    return n


def _holm(p: dict[str, float]) -> dict[str, float]:
    """Holm's adjusted p-values."""
    out, largest = {}, 0.0
    for i, name in enumerate(sorted(p, key=lambda one: p[one])):
        largest = max(largest, min(1.0, (len(p) - i) * p[name]))
        out[name] = largest
    return out


def compare_laws(presses: Sequence[Pressing], laws: Sequence[str] = LAWS) -> LawComparison:
    """Fit each law and compare them by presses they were not fitted to.

    Parameters
    ----------
    presses : three or more, at several speeds and peak forces
    laws : some of ``LAWS``

    Returns
    -------
    LawComparison

    Raises
    ------
    InputError : fewer than three presses, two of one name, or an unknown law

    Examples
    --------
    >>> import model
    >>> names = [f"presses/0.5mm_{speed}mm_per_s.csv" for speed in (2, 10, 50)]
    >>> presses = [model.felt.read_pressing(name) for name in names]
    >>> model.felt.compare_laws(presses).verdict.startswith("3 presses cannot tell")
    True
    """
    names = [press.name for press in presses]
    if len(presses) < 3:
        raise InputError(
            f"felt laws: found {len(presses)} presses, allowed 3 or more, to judge laws by presses left out"
        )
    if len(set(names)) < len(names):
        raise InputError(
            f"felt laws: {next(n for n in names if names.count(n) > 1)} is given twice; give each press once"
        )
    fits, held_out = [], np.empty((len(laws), len(presses)))
    for k, kind in enumerate(laws):
        fit, without = fit_law(kind, presses)
        fits.append(fit)
        held_out[k] = [root_mean_square(shares(law, p)) for law, p in zip(without, presses, strict=True)]
    order = np.argsort(np.log(held_out).mean(axis=1))
    best = int(order[0])
    apart = {k: np.log(held_out[k] / held_out[best]) for k in range(len(laws)) if k != best}
    adjusted = _holm({laws[k]: sign_flip_p(d) for k, d in apart.items()})
    p_value = np.array([adjusted.get(kind, 1.0) for kind in laws])
    ruled_out = {laws[k] for k, d in apart.items() if adjusted[laws[k]] <= LEVEL and d.mean() > np.log(ALIKE)}
    return LawComparison(
        tuple(names), tuple(fits), held_out, np.array([p.noise_n / p.peak_n for p in presses]), p_value,
        tuple(laws[int(k)] for k in order if laws[int(k)] not in ruled_out),
    )  # fmt: skip
