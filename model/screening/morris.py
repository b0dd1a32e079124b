"""Morris's screening: elementary effects of parameters along random ways through their uncertainties.

One way visits P + 1 points of a grid of four levels, each by changing one parameter; the effect of that change is
counted per standard uncertainty. mu* (the mean size of the effects) ranks parameters, sigma says how far an effect is
curved or depends on others. M. D. Morris, Technometrics 33 (1991); mu*: F. Campolongo, J. Cariboni, A. Saltelli,
Environmental Modelling and Software 22 (2007).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.arrays import as_numbers
from model.errors import InputError
from model.screening.distributions import Spread
from model.screening.local import FIRST, TITLES, TOTAL, Ranked, draw_ranked, unit_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = NDArray[np.float64]

LEVELS = 4
JUMP = 2  # levels that a parameter moves by
RESAMPLES = 1000
MOST_WAYS = 10_000


@dataclass(frozen=True)
class Morris(Ranked):
    """Elementary effects of P parameters on Q quantities, per standard uncertainty of each parameter.

    Attributes
    ----------
    parameters : (P,) names
    quantities : (Q,) names
    mu, mu_star, sigma : (Q, P) mean, mean size and standard deviation of the effects, in the quantity's unit
    mu_star_low, mu_star_high : (Q, P) 95 % interval of mu*, by resampling the ways
    absent : (Q,) share of members without this quantity; effects that needed one are left out
    """

    mu: Array
    mu_star: Array
    sigma: Array
    mu_star_low: Array
    mu_star_high: Array
    absent: Array
    BY = "mu_star"
    COLUMNS = ("mu", "mu_star", "mu_star_low", "mu_star_high", "sigma", "absent")


def design(count: int, ways: int, random: np.random.Generator) -> Array:
    """Shares (ways, count + 1, count) of each parameter's distribution at the points of the ways."""
    out = np.empty((ways, count + 1, count))
    for way in out:
        start = random.integers(0, LEVELS - JUMP, count)
        down = random.random(count) < 0.5
        point = np.where(down, start + JUMP, start).astype(float)
        way[0] = point
        for k, j in enumerate(random.permutation(count)):
            point[j] += -JUMP if down[j] else JUMP
            way[k + 1] = point
    # levels in the middle of equal shares, so that none lies at an end
    return np.asarray((out + 0.5) / LEVELS)


def check_ways(ways: int) -> None:
    """Refuse a number of ways that cannot be (`ModelInputError`)."""
    if not 2 <= ways <= MOST_WAYS:
        raise InputError(f"ways of Morris's method: found {ways}, allowed 2 to {MOST_WAYS}")


def morris(
    spreads: Sequence[Spread],
    compute: Callable[[Array], ArrayLike],
    quantities: Sequence[str],
    ways: int,
    seed: int = 0,
) -> Morris:
    """Screen parameters by Morris's method.

    Parameters
    ----------
    spreads : parameters with their uncertainties (P,)
    compute : values (m, P) -> quantities (m, Q), NaN where one does not exist
    quantities : names (Q,)
    ways : how many; each takes P + 1 members
    seed : of the design and the intervals

    Returns
    -------
    Morris

    Raises
    ------
    InputError : fewer than two ways, or too many

    Examples
    --------
    >>> import numpy as np, model
    >>> spreads = model.screening.spreads(model.load_action(), ["hammer.mass", "key.mass"])
    >>> u = np.array([s.u for s in spreads])
    >>> found = model.screening.morris(spreads, lambda values: (values / u) @ [[3.0], [-1.0]], ["y"], ways=4)
    >>> found.mu_star.round(6), found.mu.round(6), found.sigma.round(6)
    (array([[3., 1.]]), array([[ 3., -1.]]), array([[0., 0.]]))
    """
    check_ways(ways)
    random = np.random.default_rng(seed)
    count = len(spreads)
    points = design(count, ways, random)
    values = np.stack([spread.at(points[:, :, j]) for j, spread in enumerate(spreads)], axis=-1)
    y = marks_of(compute, values.reshape(-1, count), len(quantities)).reshape(ways, count + 1, len(quantities))
    moved = np.diff(values, axis=1) / np.array([spread.u for spread in spreads])
    which = np.argmax(np.abs(moved), axis=2)
    effects = np.full((ways, count, len(quantities)), np.nan)
    step = np.take_along_axis(moved, which[:, :, None], axis=2)
    np.put_along_axis(effects, which[:, :, None], np.diff(y, axis=1) / step, axis=1)
    draws = random.integers(0, ways, (RESAMPLES, ways))
    resampled = np.stack([_mean(np.abs(effects[draw])) for draw in draws])
    low, high = np.quantile(resampled, [0.025, 0.975], axis=0)
    mu, mu_star = _mean(effects), _mean(np.abs(effects))
    there = np.sum(~np.isnan(effects), axis=0)
    spread_of = np.nansum((effects - mu) ** 2, axis=0) / np.maximum(there - 1, 1)
    sigma = np.where(there > 1, np.sqrt(spread_of), np.nan)
    return Morris(
        tuple(spread.parameter.name for spread in spreads),
        tuple(quantities),
        mu.T,
        mu_star.T,
        sigma.T,
        low.T,
        high.T,
        np.mean(np.isnan(y), axis=(0, 1)),
    )


def marks_of(compute: Callable[[Array], ArrayLike], values: Array, count: int) -> Array:
    """What ``compute`` gives for members with ``values`` (m, P), checked: (m, count) numbers."""
    found = as_numbers(compute(values), "computed quantities", 2)
    if found.shape != (len(values), count):
        raise InputError(f"computed quantities: found shape {found.shape}, allowed {(len(values), count)}")
    return found


def _mean(effects: Array) -> Array:
    """Mean over the ways of the effects that exist; NaN where none does."""
    there = np.sum(~np.isnan(effects), axis=0)
    total = np.nansum(effects, axis=0)
    return np.divide(total, there, out=np.full(total.shape, np.nan), where=there > 0)


def draw_morris(found: Morris, path: str | Path) -> None:
    """Write mu* with its interval and sigma for the main quantities, a panel each.

    Parameters
    ----------
    found : from `morris`
    path : file to write, .svg, .pdf or .png

    Examples
    --------
    >>> import model
    >>> spreads = model.screening.spreads(model.load_action(), ["hammer.mass", "key.mass"])
    >>> found = model.screening.morris(spreads, lambda values: values[:, :1], ["y"], ways=4)
    >>> model.screening.draw_morris(found, "morris.svg")
    """

    def draw(axes: Axes, q: int, order: list[int]) -> str:
        y, size = np.arange(len(order)), found.mu_star[q]
        ends = np.abs(np.stack([found.mu_star_low[q], found.mu_star_high[q]]) - size)[:, order]
        axes.errorbar(size[order], y, xerr=ends, fmt="o", color=FIRST, capsize=2, label="mu*, 95 %")
        axes.plot(found.sigma[q][order], y, "|", color=TOTAL, markersize=9, label="sigma")
        name = found.quantities[q]
        return f"change of {TITLES.get(name, name)} per standard uncertainty, {unit_of(name)}"

    draw_ranked(found, path, draw)
