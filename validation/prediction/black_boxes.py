"""Black boxes: what measured input and answers alone say of the answer to a further stroke, with no mechanics in it.

Three kinds, each a linear least squares problem with a slight ridge: a *polynomial* of the input of the same instant; a
nonlinear *FIR* filter, a polynomial of means of the input over adjoining stretches of the past, each twice as long as
the one before; and a plain one, a polynomial of the input six *lags* ago. Degree and memory are those with the least
error on strokes left out of the fit. Answers are held within the range of those it was fitted to. What they are for and
what they cannot say: docs/explanation/null_model.md.
Source: Wiener's nonlinear filters as in Ljung (1999), *System Identification*, Section 5.2; no code of others.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import combinations_with_replacement
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from validation.conventions import Array
from validation.errors import ValidationInputError

POLYNOMIAL, FIR, FIR_LAGS = "polynomial", "fir", "fir_lags"
KINDS = (POLYNOMIAL, FIR, FIR_LAGS)
EVERY_S = 0.002
"""Between the instants that are fitted and predicted; in between straight lines."""
EDGES_S = (0.0, *(0.001 * 2.0**k for k in range(10)))
"""Ends of the stretches of the past over which the input is averaged: ten, the last to 0.5 s ago."""
LAGS_S = tuple(EVERY_S * 2.0**k for k in range(6))
"""How long ago the plain filter takes its input: six lags, the last 64 ms."""
ORDERS = {POLYNOMIAL: tuple((0, degree) for degree in range(1, 10)),
          FIR: tuple((n, d) for d, counts in ((1, (10,)), (2, (5, 6, 8, 10)), (3, (4, 5, 6))) for n in counts),
          FIR_LAGS: ((len(LAGS_S), 1), (len(LAGS_S), 2))}  # fmt: skip
"""Stretches of the past, or lags (none: the instant itself), and degrees that are tried."""
RIDGES = (1e-6, 1e-4, 1e-2)
"""Of the mean square of the terms: what keeps alike terms of a few strokes apart."""
FOLDS = 8
"""With more strokes than this they are left out in so many groups, for time."""


@dataclass(frozen=True, eq=False)
class Example:
    """One stroke: input (k,) over times (k,), s, and answers (n, c) over theirs (n,); NaN where one is not known."""

    drive_s: Array
    drive: Array
    time_s: Array
    answers: Array


@dataclass(frozen=True, eq=False)
class BlackBox:
    kind: str  # one of `KINDS`
    order: tuple[int, int]  # stretches of the past or lags, degree
    # middle, reach: the inputs it was fitted to lie within middle ± reach
    middle: float
    reach: float
    weights: Array  # (f, c), of the terms of `_terms`
    # low, high: (c,), range of the answers it was fitted to; NaN for one that was never known
    low: Array
    high: Array

    def answers(self, drive_s: Array, drive: Array, time_s: Array) -> Array:
        """Answers (n, c) at times (n,), s, to an input ``drive`` (k,) over ``drive_s`` (k,), s; the answers are clipped
        to the range of those it was fitted to."""
        grid, scaled = _grid(time_s), (drive - self.middle) / self.reach
        made = np.clip(
            _evaluate_terms(self.kind, _terms(self.kind, self.order), drive_s, scaled, grid) @ self.weights,
            self.low,
            self.high,
        )
        return np.column_stack([np.interp(time_s, grid, column) for column in made.T])

    def to_plain_values(self) -> dict[str, Any]:
        """Plain values for a file, to seven digits."""
        lists = {name: getattr(self, name).tolist() for name in ("weights", "low", "high")}
        return {"kind": self.kind, "order": list(self.order), "middle": self.middle, "reach": self.reach,
                **{name: _round_to_seven_digits(values) for name, values in lists.items()}}  # fmt: skip

    @classmethod
    def from_plain_values(cls, plain: Mapping[str, Any], where: str) -> BlackBox:
        """Black box of the plain values that a file holds; ``where`` names the file in the error for damaged ones."""
        try:
            arrays = {name: np.array(plain[name], dtype=float) for name in ("weights", "low", "high")}
            stretches, degree = map(int, plain["order"])
            made = cls(str(plain["kind"]), (stretches, degree), float(plain["middle"]), float(plain["reach"]), **arrays)
            terms = _terms(made.kind, made.order) if made.order in ORDERS[made.kind] else ()
            sound = made.weights.shape == (len(terms), made.low.size) == (len(terms), made.high.size)
        except (KeyError, TypeError, ValueError) as error:
            raise ValidationInputError(f"{where}: black box found damaged ({error}); identify the set again") from None
        if not sound:
            raise ValidationInputError(
                f"{where}: black box found with weights of another shape; identify the set again"
            )
        return made


def _round_to_seven_digits(values: Any) -> Any:
    return [_round_to_seven_digits(v) for v in values] if isinstance(values, list) else float(f"{values:.7g}")


def fit_black_boxes(examples: Sequence[Example]) -> dict[str, BlackBox]:
    """Every kind fitted to the same strokes; their order by leaving strokes out, with one stroke the lowest."""
    if not examples:
        raise ValidationInputError("black boxes: found no stroke to fit them to; needed one")
    return {kind: _Normal(kind, examples).fit_all() for kind in KINDS}


def left_out_boxes(examples: Sequence[Example]) -> list[dict[str, BlackBox]]:
    """For each stroke every kind fitted to the others; none where there is but one.

    The order is the one chosen on all of them, which favours the black boxes a little.
    """
    made = {kind: _Normal(kind, examples).fit_without_each() for kind in KINDS} if len(examples) > 1 else {}
    return [{kind: boxes[k] for kind, boxes in made.items()} for k in range(len(examples))]


class _Normal:
    """Normal equations of the largest order by groups of strokes: those of every other order are parts of them."""

    def __init__(self, kind: str, examples: Sequence[Example]) -> None:
        self.kind = kind
        inputs = [(float(one.drive.min()), float(one.drive.max())) for one in examples]
        low, high = min(a for a, _ in inputs), max(b for _, b in inputs)
        middle, reach = 0.5 * (low + high), max(0.5 * (high - low), 1e-12)
        seen = np.any([np.isfinite(one.answers).any(axis=0) for one in examples], axis=0)
        low_c = np.fmin.reduce([np.fmin.reduce(one.answers) for one in examples])
        high_c = np.fmax.reduce([np.fmax.reduce(one.answers) for one in examples])
        self.none = BlackBox(kind, ORDERS[kind][0], middle, reach, np.empty((0, 0)), low_c, high_c)
        every = dict.fromkeys(term for order in ORDERS[kind] for term in _terms(kind, order))
        self.terms = tuple(sorted(every, key=len))  # a product comes after that of its first parts
        self.group = np.arange(len(examples)) % FOLDS
        groups, f, c = int(self.group.max()) + 1, len(self.terms), low_c.size
        self.gram, self.right, self.square = np.zeros((groups, f, f)), np.zeros((groups, f, c)), np.zeros((groups, c))
        for one, k in zip(examples, self.group, strict=True):
            grid = _grid(one.time_s)
            y = np.column_stack([np.interp(grid, one.time_s, column) for column in one.answers.T])
            known = np.isfinite(y[:, seen]).all(axis=1)
            x = _evaluate_terms(kind, self.terms, one.drive_s, (one.drive - middle) / reach, grid)[known]
            y, n = np.nan_to_num(y[known]), max(int(known.sum()), 1)  # of every stroke the same weight, however long
            self.gram[k] += x.T @ x / n
            self.right[k] += x.T @ y / n
            self.square[k] += (y**2).sum(axis=0) / n

    def fit_all(self) -> BlackBox:
        return self._box(*self.choose_order(), range(len(self.gram)))

    def fit_without_each(self) -> list[BlackBox]:
        order, ridge = self.choose_order()
        boxes = [self._box(order, ridge, [g for g in range(len(self.gram)) if g != k]) for k in range(len(self.gram))]
        return [boxes[k] for k in self.group]

    def choose_order(self) -> tuple[tuple[int, int], float]:
        """Order (stretches of the past or lags, degree) and ridge with the least mean square error on left-out groups
        of strokes, each answer relative to its range; the lowest order and the largest ridge with one stroke."""
        if len(self.gram) < 2:
            return ORDERS[self.kind][0], RIDGES[-1]
        spans = np.maximum(np.nan_to_num(self.none.high - self.none.low), 1e-12)

        def error(order: tuple[int, int], ridge: float) -> float:
            at, total = self._part(order), np.zeros(spans.size)
            for k in range(len(self.gram)):
                w = self._weights(at, ridge, [g for g in range(len(self.gram)) if g != k])
                total += self.square[k] - 2 * (w * self.right[k][at]).sum(axis=0)
                total += (w * (self.gram[k][np.ix_(at, at)] @ w)).sum(axis=0)
            return float((total / spans**2).sum())

        return min(((order, ridge) for order in ORDERS[self.kind] for ridge in RIDGES), key=lambda one: error(*one))

    def _box(self, order: tuple[int, int], ridge: float, groups: Iterable[int]) -> BlackBox:
        return replace(self.none, order=order, weights=self._weights(self._part(order), ridge, list(groups)))

    def _part(self, order: tuple[int, int]) -> NDArray[np.int64]:
        place = {term: i for i, term in enumerate(self.terms)}
        return np.array([place[term] for term in _terms(self.kind, order)])

    def _weights(self, at: NDArray[np.int64], ridge: float, groups: list[int]) -> Array:
        gram = self.gram[groups].sum(axis=0)[np.ix_(at, at)]
        lift = ridge * np.maximum(np.diag(gram), 1e-9 * gram[0, 0])
        return np.asarray(cho_solve(cho_factor(gram + np.diag(lift)), self.right[groups].sum(axis=0)[at]))


@cache
def _terms(kind: str, order: tuple[int, int]) -> tuple[tuple[int, ...], ...]:
    """Terms of an order: index tuples of means or lags to multiply; -1 for Chebyshev polynomials of the instant."""
    stretches, degree = order
    of = (-1,) if kind == POLYNOMIAL else range(stretches)
    return tuple(term for d in range(degree + 1) for term in combinations_with_replacement(of, d))


def _grid(time_s: Array) -> Array:
    return np.linspace(time_s[0], time_s[-1], max(round(float(time_s[-1] - time_s[0]) / EVERY_S), 1) + 1)


def _evaluate_terms(kind: str, terms: Sequence[tuple[int, ...]], time_s: Array, drive: Array, at_s: Array) -> Array:
    """Values (m, f) of the f ``terms`` (as of `_terms`) at times ``at_s`` (m,), s, for an input ``drive`` (n,), scaled
    to -1 … 1, over ``time_s`` (n,), s; before its first sample the input is held."""
    if kind == POLYNOMIAL:  # powers of the ninth degree are too alike
        at = np.clip(np.interp(at_s, time_s, drive), -1.0, 1.0)
        return np.asarray(np.polynomial.chebyshev.chebvander(at, len(terms) - 1), dtype=float)
    if kind == FIR_LAGS:
        inputs = [np.interp(at_s - lag, time_s, drive) for lag in LAGS_S]
    else:
        times = np.concatenate([[float(time_s[0]) - EDGES_S[-1]], time_s])
        values = np.concatenate([drive[:1], drive])
        summed = np.concatenate([[0.0], np.cumsum(0.5 * np.diff(times) * (values[1:] + values[:-1]))])
        ends = [np.interp(at_s - edge, times, summed) for edge in EDGES_S]
        inputs = [(a - b) / (EDGES_S[k + 1] - EDGES_S[k]) for k, (a, b) in enumerate(zip(ends, ends[1:], strict=False))]
    products: dict[tuple[int, ...], Array] = {(): np.ones(at_s.size)}
    for term in terms[1:]:
        products[term] = products[term[:-1]] * inputs[term[-1]]
    return np.column_stack(list(products.values()))
