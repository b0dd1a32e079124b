"""What programs do: blocks, loops, lanes, numbers side by side; elementary functions to the last digits."""

from __future__ import annotations

import math

import numpy as np
import pytest

from model.compiler.expressions import (
    ONE,
    ZERO,
    compute_where,
    constant,
    cosine,
    exponential,
    intern,
    maximum,
    read,
    root,
    sine,
    solve_by_newton,
    tanh,
    value_of,
    where,
)  # fmt: skip
from model.compiler.programs import (
    Accumulate,
    Assign,
    If,
    While,
    as_integer,
    compute_vectorised,
    loop_over,
    slot,
    variable,
)
from tests.model.compiler.machine import given, machine

RANDOM = np.random.default_rng(4)
ANGLES = np.concatenate([RANDOM.uniform(-0.8, 0.8, 200), RANDOM.uniform(-100.0, 100.0, 200), [0.0, 0.7853981633974483]])


def test_elementary_functions_are_those_of_the_c_library_to_two_units_in_the_last_place() -> None:
    x = given(0)
    run = machine([exponential(x), tanh(x), cosine(x), sine(x), root(abs(x))])
    for value in ANGLES:
        y = run(np.array([value]))
        want = [math.exp(value), math.tanh(value), math.cos(value), math.sin(value), math.sqrt(abs(value))]
        assert abs(y[0] / want[0] - 1.0) < 3e-16
        np.testing.assert_allclose(y[1:4], want[1:4], rtol=0.0, atol=3e-16)
        assert y[4] == want[4]


def test_tanh_keeps_its_sign_and_ends_at_one() -> None:
    run = machine([tanh(given(0))])
    for value in (-1e300, -30.0, -0.0, 0.0, 19.6, 1e6):
        assert run(np.array([value]))[0] == math.tanh(value)
    assert math.copysign(1.0, run(np.array([-0.0]))[0]) == -1.0
    assert math.isnan(run(np.array([math.nan]))[0])


@pytest.mark.parametrize("lanes", [1, 4, 8])
def test_a_lane_gets_what_it_gets_alone(lanes: int) -> None:
    x, y = given(0), given(1)
    inside = [
        Accumulate(variable("sum"), x * y),
        If(y > 0.5, [Assign(variable("way"), ONE)], [Assign(variable("way"), -ONE)]),
    ]
    program = [
        Assign(variable("sum"), y), If(x > 0.0, inside, [Assign(variable("way"), constant(7.0))]),
        While(value_of("sum") > 1.0, [
            Assign(variable("sum"), 0.5 * value_of("sum")), Accumulate(variable("turns"), ONE)]),
        Assign(slot("y", 0), value_of("sum")), Assign(slot("y", 1), value_of("way")),
        Assign(slot("y", 2), value_of("turns")),
        Assign(slot("y", 3), compute_where(x > 0.0, root(x))), Assign(slot("y", 4), tanh(x) + sine(20.0 * y)),
    ]  # fmt: skip
    rows = RANDOM.uniform(-3.0, 9.0, (2, lanes))
    found = machine(program, lanes)(rows[:, 0] if lanes == 1 else rows)
    for lane in range(lanes):
        a, b = rows[:, lane]
        total, turns = (b + a * b if a > 0.0 else b), 0
        while total > 1.0:
            total, turns = 0.5 * total, turns + 1
        want = [total, (1.0 if b > 0.5 else -1.0) if a > 0.0 else 7.0, turns, math.sqrt(max(a, 0.0)),
                math.tanh(a) + math.sin(20.0 * b)]  # fmt: skip
        np.testing.assert_allclose(found[:5] if lanes == 1 else found[:5, lane], want, rtol=1e-15, atol=1e-15)


def test_a_lane_that_takes_no_part_keeps_its_bits() -> None:
    nothing = If(given(0) > 0.0, [Accumulate(slot("y", 0), given(1)), Assign(slot("y", 1), given(1))])
    run = machine([Assign(slot("y", 0), given(1)), Assign(slot("y", 1), -given(1)), nothing], 4)
    found = run(np.array([[-1.0, 1.0, -1.0, 1.0], [-0.0, 2.0, np.nan, 0.0]]))
    assert math.copysign(1.0, found[0, 0]) == -1.0 and found[0, 1] == 4.0
    assert np.isnan(found[0, 2]) and found[1, 1] == 2.0


def test_loops_read_behind_a_place_and_see_what_they_changed() -> None:
    count = as_integer(given(0))

    def one(i):  # type: ignore[no-untyped-def]
        return [
            Accumulate(variable("sum"), value_of("last") * read("x", 1, i)),
            Assign(variable("last"), read("x", 1, i)),
        ]

    run = machine([Assign(variable("last"), ONE), loop_over("row", count, one), Assign(slot("y", 0), value_of("sum"))])
    assert run(np.array([4.0, 2.0, 3.0, 5.0, 7.0, 11.0]))[0] == 2.0 + 6.0 + 15.0 + 35.0
    assert run(np.array([0.0, 2.0]))[0] == 0.0


@pytest.mark.parametrize("lanes", [1, 4])
def test_newton_finds_the_root_and_knows_its_slope(lanes: int) -> None:
    from model.compiler.expressions import differentiate_once, differentiator

    @differentiate_once
    def cube_root(by):  # type: ignore[no-untyped-def]
        f = intern("argument", "f")
        return solve_by_newton(f, f * f * f - by[0], maximum(by[0], 1.0))

    x = given(0)
    y = cube_root((x,))
    run = machine([y, differentiator({x: ONE})(y)], lanes)
    values = np.array([8.0, 27.0, 1.0, 0.3])[:lanes]
    found = run(values[None] if lanes > 1 else values)[:2].reshape(2, -1)
    np.testing.assert_allclose(found[0], np.cbrt(values), rtol=1e-14)
    np.testing.assert_allclose(found[1], np.cbrt(values) / (3.0 * values), rtol=1e-13)


def test_like_numbers_side_by_side_are_those_of_each_alone() -> None:
    xs = [given(k) for k in range(5)]
    bumped = [x * tanh(3.0 * x) + compute_where(intern("differs", x, ZERO), 1.0 / where(x > 0.0, x, 2.0)) for x in xs]
    turned = [cosine(x) for x in xs]
    run = machine(
        [
            compute_vectorised(*bumped),
            compute_vectorised(*turned),
            *(Assign(slot("y", k), e) for k, e in enumerate(bumped + turned)),
        ]
    )
    alone = machine([given(0) * tanh(3.0 * given(0)), cosine(given(0))])
    for values in RANDOM.normal(size=(50, 5)):
        values[0] = 0.0
        found = run(values)
        for k, value in enumerate(values):
            product, cosine_ = alone(np.array([value]))[:2]
            more = 0.0 if value == 0.0 else 1.0 / (value if value > 0.0 else 2.0)
            np.testing.assert_allclose(found[[k, 5 + k]], [product + more, cosine_], rtol=2e-15, atol=1e-16)
