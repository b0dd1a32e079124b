"""Sobol' indices: the share of a quantity's variance that each parameter is responsible for, alone and in all.

First index: what would vanish on average if the parameter were known. Total index: what would remain if all others
were. Estimators are SciPy's (`scipy.stats.sobol_indices`: Saltelli 2010), intervals the quantiles of resampled
members, points a scrambled Sobol' sequence; a study of P parameters takes n (P + 2) members.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.stats import qmc, sobol_indices

from model.errors import InputError
from model.screening.distributions import Spread
from model.screening.local import FIRST, TITLES, TOTAL, Ranked, draw_ranked
from model.screening.morris import marks_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = NDArray[np.float64]

RESAMPLES = 500
MOST = 2**20
FEW_ABSENT = 0.02  # share of members without a quantity up to which its indices are given


@dataclass(frozen=True)
class Sobol(Ranked):
    """Indices of P parameters for Q quantities; NaN for a quantity that does not vary or is too often absent.

    Attributes
    ----------
    parameters : (P,) names
    quantities : (Q,) names
    first, total : (Q, P)
    first_low, first_high, total_low, total_high : (Q, P) 95 % intervals by resampling
    mean, deviation : (Q,) of the quantity over the members that have it
    absent : (Q,) share of members without it; up to 2 % the median stands in for them
    """

    first: Array
    first_low: Array
    first_high: Array
    total: Array
    total_low: Array
    total_high: Array
    mean: Array
    deviation: Array
    absent: Array
    BY = "total"
    COLUMNS = (
        *("first", "first_low", "first_high", "total", "total_low", "total_high"),
        *("mean", "deviation", "absent"),
    )


def members(count: int, n: int) -> int:
    """Number of members of a study of ``count`` parameters."""
    return n * (count + 2)


def check_base(n: int) -> None:
    """Refuse a number of base members that cannot be (`ModelInputError`)."""
    if not (8 <= n <= MOST and n & (n - 1) == 0):
        raise InputError(f"Sobol' base members: found {n}, allowed a power of 2 from 8 to {MOST}")


def sobol(
    spreads: Sequence[Spread],
    compute: Callable[[Array], ArrayLike],
    quantities: Sequence[str],
    n: int,
    seed: int = 0,
) -> Sobol:
    """Sobol' indices of parameters over their uncertainties.

    Parameters
    ----------
    spreads : parameters with their uncertainties (P,)
    compute : values (m, P) -> quantities (m, Q), NaN where one does not exist
    quantities : names (Q,)
    n : base members, a power of 2; n (P + 2) members are computed
    seed : of the points and the intervals

    Returns
    -------
    Sobol

    Raises
    ------
    InputError : n is no power of 2 from 8, or quantities are not (m, Q) numbers

    Examples
    --------
    >>> import model
    >>> spreads = model.screening.spreads(model.load_action(), ["hammer.mass", "key.mass"])
    >>> found = model.screening.sobol(spreads, lambda values: values[:, :1], ["y"], n=256)
    >>> found.first.round(2)
    array([[1., 0.]])
    """
    check_base(n)
    count = len(spreads)
    random = np.random.default_rng(seed)
    shares = qmc.Sobol(2 * count, rng=random).random(n)
    a, b = (
        np.stack([spread.at(half[:, j]) for j, spread in enumerate(spreads)], axis=1)
        for half in (shares[:, :count], shares[:, count:])
    )
    mixed = [np.where(np.arange(count) == j, b, a) for j in range(count)]
    y = marks_of(compute, np.concatenate([a, b, *mixed]), len(quantities))
    absent = np.mean(np.isnan(y), axis=0)
    rows = [_indices(y[:, q], n, count, float(absent[q]), random) for q in range(len(quantities))]
    first, total = (np.array([row[k] for row in rows]).reshape(len(rows), 3, count) for k in (0, 1))
    own = y[: 2 * n]
    there = np.sum(~np.isnan(own), axis=0)
    mean = np.divide(np.nansum(own, axis=0), there, out=np.full(len(quantities), np.nan), where=there > 0)
    square = np.divide(
        np.nansum((own - mean) ** 2, axis=0), there - 1, out=np.full(len(quantities), np.nan), where=there > 1
    )
    return Sobol(
        tuple(spread.parameter.name for spread in spreads),
        tuple(quantities),
        first=first[:, 0],
        first_low=first[:, 1],
        first_high=first[:, 2],
        total=total[:, 0],
        total_low=total[:, 1],
        total_high=total[:, 2],
        mean=mean,
        deviation=np.sqrt(square),
        absent=absent,
    )


def _indices(y: Array, n: int, count: int, absent: float, random: np.random.Generator) -> tuple[Array, Array]:
    """First and total indices (3, P) of one quantity: estimate, ends of the 95 % interval."""
    nothing = np.full((3, count), np.nan)
    if absent > FEW_ABSENT:
        return nothing, nothing
    y = np.where(np.isnan(y), np.median(y[~np.isnan(y)]), y)
    if not np.ptp(y) > 1e-12 * np.max(np.abs(y)):
        return nothing, nothing
    y = y - np.mean(y[: 2 * n])  # the estimators lose digits to a large mean
    parts = {"f_A": y[None, :n], "f_B": y[None, n : 2 * n], "f_AB": y[2 * n :].reshape(count, 1, n)}
    found = sobol_indices(func=parts, n=n, rng=random)
    drawn = [_resampled(parts, random.integers(0, n, n)) for _ in range(RESAMPLES)]
    ends = np.quantile(np.array(drawn), [0.025, 0.975], axis=0)  # (2, first and total, P)
    first, total = (
        np.stack([np.ravel(index), ends[0, k], ends[1, k]])
        for k, index in enumerate((found.first_order, found.total_order))
    )
    return first, total


def _resampled(parts: dict[str, Array], rows: NDArray[np.int64]) -> Array:
    """First and total indices (2, P) of some of the members, by the estimators of `sobol_indices`."""
    a, b, mixed = parts["f_A"][0, rows], parts["f_B"][0, rows], parts["f_AB"][:, 0, rows]
    variance = np.var(np.concatenate([a, b]))
    first = np.mean(b * (mixed - a), axis=1)
    total = 0.5 * np.mean((mixed - a) ** 2, axis=1)
    return np.stack([first, total]) / variance


def draw_sobol(found: Sobol, path: str | Path) -> None:
    """Write first and total indices with their intervals for the main quantities, a panel each.

    Parameters
    ----------
    found : from `sobol`
    path : file to write, .svg, .pdf or .png

    Examples
    --------
    >>> import model
    >>> spreads = model.screening.spreads(model.load_action(), ["hammer.mass", "key.mass"])
    >>> found = model.screening.sobol(spreads, lambda values: values[:, :1], ["y"], n=64)
    >>> model.screening.draw_sobol(found, "sobol.svg")
    """

    def draw(axes: Axes, q: int, order: list[int]) -> str:
        y = np.arange(len(order), dtype=float)
        for shift, color, name in ((0.15, FIRST, "first"), (-0.15, TOTAL, "total")):
            index, low, high = (getattr(found, name + part)[q][order] for part in ("", "_low", "_high"))
            ends = np.abs(np.stack([low, high]) - index)
            axes.errorbar(index, y + shift, xerr=ends, fmt="o", ms=4, color=color, capsize=2, label=name)
        axes.axvline(0.0, color="0.6", linewidth=0.8)
        return f"share of the variance of {TITLES.get(found.quantities[q], found.quantities[q])}, 95 % intervals"

    draw_ranked(found, path, draw)
