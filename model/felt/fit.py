"""One law's parameters from several presses of a felt, by least squares of the force.

Every press counts alike: its residual is taken as a share of its peak force, so that the hardest press does not decide
alone. Parameters are searched in coordinates that keep a law passive; standard uncertainties are the jackknife over
presses, because what a law lacks is common to all samples of a press and the samples' scatter would understate it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import least_squares
from scipy.stats.qmc import Sobol

from model.arrays import ArrayRecord
from model.elements.laws.known import LAWS as KNOWN
from model.errors import InputError
from model.felt.felt_response import LONGEST_REACH, FeltLaw, HuntCrossley, Hysteresis, NamedLaw, Stulov
from model.felt.pressing import Pressing

FEWEST_PRESSES = 2  # one is left out at a time
MOST_EVALUATIONS = 400  # of the residuals, per start
STARTS = 4  # of a search, spread over its box: choice; eight find the same minima of 18 fits
LARGEST_SHARE = 20.0  # of the largest force, of one term at the deepest point: choice, far beyond any felt
CUBIC_UNITS = ("N/m^3", "N/m^2", "N/m")
DECADES = 100.0  # ratio of a number's limits from which its logarithm is searched

Array = NDArray[np.float64]


class Search(NamedTuple):
    """Coordinates of a law's search, numbers of order one in a box; starts lie in its part up to ``usual``."""

    low: tuple[float, ...]
    usual: tuple[float, ...]
    high: tuple[float, ...]
    law: Callable[[Array], FeltLaw]
    names: tuple[str, ...]
    units: tuple[str, ...]
    values: Callable[[FeltLaw], tuple[float, ...]]


@dataclass(frozen=True)
class LawFit(ArrayRecord):
    """A law fitted to presses.

    Attributes
    ----------
    kind : name of the law
    law : with the fitted parameters
    names, units, values, u : of the parameters, a, b, c as ``contact02.normal.a`` and so on take them; ``u`` is the
        jackknife over presses, NaN with fewer than three
    misfit : (m,) root mean square residual of each press as a share of its peak force
    held_out : (m,) the same of each press by the law fitted to the others
    """

    kind: str
    law: FeltLaw
    names: tuple[str, ...]
    units: tuple[str, ...]
    values: tuple[float, ...]
    u: tuple[float, ...]
    misfit: Array
    held_out: Array

    @property
    def typical_held_out(self) -> float:
        """Geometric mean of the held-out errors."""
        return float(np.exp(np.mean(np.log(self.held_out))))


def relative_residuals(law: FeltLaw, press: Pressing) -> Array:
    """Residuals (n,) of a law on a press: modelled minus measured force, as a share of the peak force."""
    return (law.response(press.time_s, press.depth_m).force_n - press.force_n) / press.peak_n


def root_mean_square(residual: Array) -> float:
    """Root mean square of residuals (n,)."""
    return float(np.sqrt(np.mean(residual**2)))


def _cubic(s: Array, depth: float, force: float) -> tuple[float, float, float]:
    """Return a, b, c of non-negative stiffness: shares of the largest force, b from its bound on."""
    a, c = s[0] * force / depth**3, s[2] * force / depth
    return a, s[1] * force / depth**2 - float(np.sqrt(3.0 * a * c)), c


def law_search(kind: str, presses: Sequence[Pressing]) -> Search:
    """Search for the parameters of the law ``kind`` (``hunt-crossley``, ``hysteresis``, ``stulov`` or an added one):
    box of coordinates, and maps to law and parameters, scaled by depth, force and speed of ``presses``."""
    depth, force = max(p.deepest_m for p in presses), max(p.peak_n for p in presses)
    speed = float(np.nanmedian([p.speed_m_per_s for p in presses]))
    if kind == "hunt-crossley":
        return Search(
            (0.0,) * 4, (1.0,) * 4, (LARGEST_SHARE,) * 4,
            lambda s: HuntCrossley(*_cubic(s, depth, force), s[3] / speed), ("a", "b", "c", "D"),
            (*CUBIC_UNITS, "s/m"), lambda law: (law.a, law.b, law.c, law.d),  # type: ignore[attr-defined]
        )  # fmt: skip
    if kind == "hysteresis":
        return Search(
            (0.0, 0.0, 0.0, 0.0, 0.01), (1.0, 1.0, 1.0, 1.0, LONGEST_REACH),  # the way of a hundredth is gone at once
            (LARGEST_SHARE, LARGEST_SHARE, LARGEST_SHARE, 1.0, LONGEST_REACH),
            lambda s: Hysteresis(*_cubic(s, depth, force), (s[3],), (s[4],)), ("a", "b", "c", "beta", "eta"),
            (*CUBIC_UNITS, "1", "1"),
            lambda law: (*law._kernel_arguments()[2], law.beta[0], law.eta[0]),  # type: ignore[attr-defined]
        )  # fmt: skip
    if kind != "stulov":
        return cubic_law_search(kind, depth, force, speed)
    # slow presses know Q0 = F0 (1 - eps) and alpha = tau0 eps / (1 - eps) better than F0, eps and tau0 apart
    lasts = float(np.median([p.time_s[-1] - p.time_s[0] for p in presses]))

    def stulov(s: Array) -> Stulov:
        alpha, tau = lasts * float(np.exp(s[2])), lasts * float(np.exp(s[3]))
        epsilon = min(alpha / (alpha + tau), 1.0 - 1e-9)
        return Stulov(float(np.exp(s[0])) * force / depth ** s[1] / (1.0 - epsilon), s[1], epsilon, tau)

    def numbers(law: FeltLaw) -> tuple[float, ...]:
        assert isinstance(law, Stulov)
        left = 1.0 - law.epsilon
        return law.f0 * left, law.p, law.tau_s * law.epsilon / left, law.tau_s

    return Search(
        # logarithms of Q0 and of alpha and tau0 as shares of the press's length, and the power p between them
        (-4.0, 1.0, -14.0, -14.0), (1.0, 4.0, 0.0, 0.0), (4.0, 8.0, 3.0, 3.0), stulov,
        ("Q0", "p", "alpha", "tau0"), ("N/m^p", "1", "s", "s"), numbers,
    )  # fmt: skip


def cubic_law_search(kind: str, depth: float, force: float, speed: float) -> Search:
    """Search for a, b, c, D (where the law has it) and own numbers of the law ``kind`` within their ranges, scaled by
    ``depth`` (m), ``force`` (N) and ``speed`` (m/s); as logarithms where these span decades."""
    numbers = KNOWN[kind].numbers
    far = {name for name, n in numbers.items() if n.low > 0.0 and n.high > DECADES * n.low}
    damped = KNOWN[kind].damped

    def to_coordinate(name: str, x: float) -> float:
        return math.log(x) if name in far else x

    def law(s: Array) -> NamedLaw:
        own = {name: math.exp(x) if name in far else float(x) for name, x in zip(numbers, s[3 + damped :], strict=True)}
        values = {name: min(max(x, numbers[name].low), numbers[name].high) for name, x in own.items()}
        return NamedLaw(kind, *_cubic(s, depth, force), s[3] / speed if damped else 0.0, values)

    def to_law_coordinates(felt: FeltLaw) -> tuple[float, ...]:
        assert isinstance(felt, NamedLaw)
        return felt.a, felt.b, felt.c, *[felt.d] * damped, *felt.values.values()

    low, high = ([to_coordinate(k, getattr(n, at)) for k, n in numbers.items()] for at in ("low", "high"))
    shares = 3 + damped
    return Search(
        (*[0.0] * shares, *low), (*[1.0] * shares, *high), (*[LARGEST_SHARE] * shares, *high), law,
        ("a", "b", "c", *["D"] * damped, *numbers),
        (*CUBIC_UNITS, *["s/m"] * damped, *(n.unit for n in numbers.values())), to_law_coordinates,
    )  # fmt: skip


def draw_starts(search: Search) -> Array:
    """Starts (STARTS, k) spread over the usual part of a search's box, the same each time."""
    share = Sobol(len(search.low), seed=0).random(STARTS)
    return np.asarray(search.low + share * np.subtract(search.usual, search.low))


def _fit_coordinates(search: Search, presses: Sequence[Pressing], starts: ArrayLike) -> Array:
    """Coordinates (k,) of the search at the least sum of squared relative residuals of all presses, the best of those
    found from ``starts`` (s, k)."""

    def residual(s: Array) -> Array:
        law = search.law(s)
        return np.concatenate([relative_residuals(law, press) / np.sqrt(len(press.force_n)) for press in presses])

    found = [
        least_squares(residual, start, bounds=(search.low, search.high), x_scale="jac", max_nfev=MOST_EVALUATIONS)
        for start in np.asarray(starts)
    ]
    return np.asarray(min(found, key=lambda one: float(one.cost)).x, dtype=float)


def fit_law(kind: str, presses: Sequence[Pressing]) -> LawFit:
    """Fit the law ``kind`` (``hunt-crossley``, ``hysteresis``, ``stulov`` or an added one) to two or more presses, and
    once more without each, which gives uncertainties and held-out errors.

    Parameters
    ----------
    kind : one of ``LAWS``, or a law that `model.add_law` has added, with all its numbers on a cubic curve
    presses : two or more

    Returns
    -------
    LawFit
        Parameters fitted to all presses.

    Raises
    ------
    InputError : unknown law, too few presses, or one given twice

    Examples
    --------
    >>> import model
    >>> names = [f"presses/0.5mm_{speed}mm_per_s.csv" for speed in (2, 10, 50)]
    >>> presses = [model.felt.read_pressing(name) for name in names]
    >>> fit = model.felt.fit_law("hunt-crossley", presses)
    >>> fit.names, fit.held_out.shape
    (('a', 'b', 'c', 'D'), (3,))
    """
    if kind not in KNOWN:
        raise InputError(f"felt law: found {kind!r}, allowed {', '.join(KNOWN)}")
    if len(presses) < FEWEST_PRESSES:
        raise InputError(f"felt law {kind}: found {len(presses)} presses, allowed {FEWEST_PRESSES} or more")
    names = [press.name for press in presses]
    if len(set(names)) < len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise InputError(f"felt law {kind}: {twice} is given twice; give each press once")
    search = law_search(kind, presses)
    starts = draw_starts(search)
    best = _fit_coordinates(search, presses, starts)
    law = search.law(best)
    # the others differ little from all: one start, at the best of all
    inside = np.clip(best, np.add(search.low, 1e-6), np.subtract(search.high, 1e-6))
    without = [
        search.law(_fit_coordinates(search, [p for p in presses if p is not one], [inside, starts[0]]))
        for one in presses
    ]
    n = len(presses)
    values = np.array([search.values(one) for one in without])
    spread = np.sqrt((n - 1) / n * np.sum((values - values.mean(axis=0)) ** 2, axis=0))
    u = spread if n > 2 else np.full(len(search.names), np.nan)
    return LawFit(
        kind, law, search.names, search.units, search.values(law), tuple(u.tolist()),
        np.array([root_mean_square(relative_residuals(law, press)) for press in presses]),
        np.array([root_mean_square(relative_residuals(a, b)) for a, b in zip(without, presses, strict=True)]),
    )  # fmt: skip
