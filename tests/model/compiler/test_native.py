"""What programs do: blocks, loops, lanes, numbers side by side; elementary functions to the last digits."""

from __future__ import annotations

import math

import numpy as np
import pytest

from model.compiler.expressions import (
    ONE,
    compute_where,
    constant,
    cosine,
    exponential,
    intern,
    maximum,
    root,
    sine,
    solve_by_newton,
    tanh,
    value_of,
)  # fmt: skip
from model.compiler.programs import (
    Accumulate,
    Assign,
    If,
    While,
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
