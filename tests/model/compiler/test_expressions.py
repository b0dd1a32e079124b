"""Expressions: equal ones are one object, sums lose nothing, every rule of differentiation against differences."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given as drawn
from hypothesis import strategies as st

from model.compiler.expressions import (
    ONE,
    ZERO,
    Expression,
    as_expression,
    compute_where,
    constant,
    cosine,
    differentiate_once,
    differentiator,
    exponential,
    intern,
    maximum,
    minimum,
    read,
    root,
    sine,
    tanh,
    where,
)  # fmt: skip
from tests.model.compiler.machine import given, machine

Rule = Callable[[Expression, Expression], Expression]
RULES: dict[str, Rule] = {
    "sum": lambda a, b: a + b - 3.0 * a,
    "product": lambda a, b: a * b * a,
    "quotient": lambda a, b: a / (b * b + 1.0),
    "root": lambda a, b: root(a * a + b * b + 0.1),
    "exponential": lambda a, b: exponential(a * b),
    "tanh": lambda a, b: tanh(a - 2.0 * b),
    "turn": lambda a, b: cosine(a * b) + sine(a - b),
    "abs": lambda a, b: abs(a) * b,
    "largest": lambda a, b: maximum(a, b, a * b) + minimum(a, 2.0 * b),
    "where": lambda a, b: where(a > b, a * a, b * a),
    "guarded": lambda a, b: compute_where(a > 0.0, a * root(abs(b) + 1.0)),
    "law": lambda a, b: differentiate_once(lambda by, k: by[0] * by[0] * k / (1.0 + by[1] * by[1]))(
        (a * b, a - b), as_expression(3.0)
    ),
    "law of its own number": lambda a, b: differentiate_once(lambda by, k: by[0] * k + by[0] * by[0])((a,), b),
    "law in law": lambda a, b: differentiate_once(lambda by: RULES["law"](by[0], by[1] + by[0]))((a, b)),
}


@pytest.mark.parametrize("name", RULES)
def test_rules_of_differentiation_equal_differences(name: str) -> None:
    a, b = given(0), given(1)
    e = RULES[name](a, b)
    run = machine(
        [
            e,
            differentiator({a: ONE})(e),
            differentiator({b: ONE})(e),
            differentiator({a: as_expression(0.3), b: as_expression(-2.0)})(e),
        ]
    )
    random, h = np.random.default_rng(2), 1e-6
    for x in random.normal(size=(30, 2)):
        by = [(run(x + h * way)[0] - run(x - h * way)[0]) / (2.0 * h) for way in np.eye(2)]
        np.testing.assert_allclose(run(x)[1:4], [*by, 0.3 * by[0] - 2.0 * by[1]], rtol=1e-7, atol=1e-7)


def test_equal_expressions_are_one_and_arms_lose_their_pivot() -> None:
    a, b, c = (read("w", k) for k in range(3))
    assert a * b + c is c + b * a
    assert (a + b) - a is b and a - (a + b) is -b and (a - b) - a is -b and a - (a - b) is b
    assert a - a is ZERO and 0.0 * a is ZERO and 1.0 * a is a and -1.0 * -a is a and -1.0 * a is -a
    assert (-a) * b is -(a * b) and a + (-b) is a - b and -a - b is -(a + b)
    assert constant(-0.0) is ZERO and a / 4.0 is a * 0.25
    assert where(a > b, c, c) is c and compute_where(a > b, 0.0) is ZERO


@drawn(st.lists(st.floats(-1e3, 1e3), min_size=4, max_size=4))
def test_what_is_simplified_has_the_same_value(values: list[float]) -> None:
    a, b, c, d = values
    e = [as_expression(x) for x in values]
    found = [(e[0] + e[1]) - e[1] * e[2], -(e[0] - e[3]) * e[2], (e[0] * e[1]) / 8.0]
    want = [(a + b) - b * c, -(a - d) * c, (a * b) / 8.0]
    assert [x.args[0] for x in found] == pytest.approx(want)


def test_what_has_no_derivative_says_so() -> None:
    x = given(0)
    with pytest.raises(TypeError, match="two_to"):
        differentiator({x: ONE})(intern("two_to", x))
