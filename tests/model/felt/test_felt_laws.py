"""Laws of felt against closed forms, an independent integration, and the inequality that makes them passive."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from model import InputError
from model.felt import FeltLaw, HuntCrossley, Hysteresis, Stulov

CUBIC = (4.41e10, -1.02e7, 1.57e4)  # contact02 of Table A.8: a, b, c
DEEP = 6e-4

Array = NDArray[np.float64]


def random_law(rng: np.random.Generator) -> FeltLaw:
    """Draw a law with random parameters within what it allows."""
    a, c = 10.0 ** rng.uniform(8, 11), 10.0 ** rng.uniform(3, 5)
    b = rng.uniform(-math.sqrt(3.0 * a * c), 3e7)
    kind = rng.integers(3)
    if kind == 0:
        return HuntCrossley(a, b, c, 10.0 ** rng.uniform(-2, 1))
    if kind == 1:
        return Stulov(
            10.0 ** rng.uniform(7, 10), rng.uniform(1.0, 4.0), rng.uniform(0.0, 0.995), 10 ** rng.uniform(-5, -1)
        )
    beta = rng.dirichlet([1.0, 1.0, 1.0])[:2]
    return Hysteresis(a, b, c, tuple(beta), tuple(rng.uniform(0.02, 0.4, 2)))


def random_press(rng: np.random.Generator) -> tuple[Array, Array]:
    """Time and depth of a closed press from 0 to 0 with minor loops, straight between its turning points."""
    turns = np.concatenate([[0.0], rng.uniform(-0.2, 1.0, rng.integers(1, 7)) * DEEP, [0.0]])
    speed = 10.0 ** rng.uniform(-3, 0)
    seconds = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(turns)) / speed * rng.uniform(0.3, 3.0) + 1e-6)])
    time_s = np.unique(np.concatenate([np.linspace(0.0, seconds[-1], 1500), seconds]))
    return time_s, np.interp(time_s, seconds, turns)


def work(force_n: Array, depth_m: Array) -> Array:
    """Work done on the felt since the first sample, J, by the trapezoidal rule."""
    return np.concatenate([[0.0], np.cumsum(0.5 * (force_n[1:] + force_n[:-1]) * np.diff(depth_m))])


def test_no_closed_press_gives_energy() -> None:
    rng = np.random.default_rng(5)
    for _ in range(300):
        law, (time_s, depth_m) = random_law(rng), random_press(rng)
        force, stored = law.response(time_s, depth_m)
        assert force.min() >= 0.0
        assert stored.min() >= -1e-15
        gained = stored[-1] - work(force, depth_m)[-1]
        assert gained <= 2e-3 * stored.max() + 1e-12, law  # what the trapezoidal rule misses


@settings(deadline=None, max_examples=60)
@given(st.floats(0.01, 1.0), st.floats(0.02, 0.4), st.floats(0.05, 0.9))
def test_the_loop_of_a_history_has_its_closed_form_at_any_speed(beta: float, eta: float, share: float) -> None:
    a, b, c = 2e10, 0.0, 1e4
    law = Hysteresis(a, b, c, (beta,), (eta,))
    top = share * 1e-3
    areas = []
    for speed in (1e-3, 1e-1):
        depth = np.concatenate([np.linspace(0.0, top, 4001), np.linspace(top, 0.0, 4001)[1:]])
        time_s = np.arange(len(depth)) * top / 4000 / speed
        areas.append(work(law.response(time_s, depth).force_n, depth)[-1])
    # way in f (1 + beta), way out f (1 + beta (2 (x/top)^(1/eta) - 1)); integrate the powers of x
    q = 1.0 / eta
    closed = 2.0 * beta * sum(k * top ** (n + 1) * (1.0 / (n + 1) - 1.0 / (n + 1 + q)) for n, k in ((3, a), (1, c)))
    assert areas[0] == pytest.approx(areas[1], rel=1e-12)
    assert areas[0] == pytest.approx(closed, rel=1e-4)


def test_a_minor_loop_closes_on_itself() -> None:
    law = Hysteresis(*CUBIC, (0.2, 0.1), (0.05, 0.3))
    one = np.concatenate([np.linspace(5e-4, 4e-4, 50), np.linspace(4e-4, 5e-4, 50)[1:]])
    depth = np.concatenate([np.linspace(0.0, 5e-4, 100), *(one[1:] for _ in range(60))])
    force = law.response(np.arange(len(depth)) * 1e-3, depth).force_n
    assert force[-98:] == pytest.approx(force[-2 * 98 : -98], rel=1e-9)


@pytest.mark.parametrize("seed", range(8))
def test_stulov_against_an_independent_integration(seed: int) -> None:
    rng = np.random.default_rng(seed)
    p, epsilon, tau = rng.uniform(1.2, 3.5), rng.uniform(0.3, 0.95), 10.0 ** rng.uniform(-4, -2)
    law = Stulov(1e9, p, epsilon, tau)
    seconds = np.sort(np.concatenate([[0.0, 0.1], rng.uniform(0.0, 0.1, 5)]))
    turns = np.concatenate([[0.0], rng.uniform(0.0, 1.0, 5) * DEEP, [0.0]])
    time_s = np.linspace(0.0, 0.1, 20_001)

    def rate(t: float, h: Array) -> list[float]:
        u = max(float(np.interp(t, seconds, turns)), 0.0) ** p
        return [(max(u, epsilon * h[0]) - h[0]) / tau]

    seen = solve_ivp(rate, (0.0, 0.1), [0.0], method="LSODA", t_eval=time_s, rtol=1e-10, atol=1e-22, max_step=1e-4)
    depth = np.interp(time_s, seconds, turns)
    force = 1e9 * np.maximum(depth**p - epsilon * seen.y[0], 0.0)
    assert law.response(time_s, depth).force_n == pytest.approx(force, rel=0.0, abs=2e-4 * force.max())


@pytest.mark.parametrize(
    "law", [HuntCrossley(*CUBIC, 1.2), Stulov(1e10, 2.5, 0.9, 1e-3), Hysteresis(*CUBIC, (0.3,), (0.3,))]
)
def test_force_is_continuous_where_surfaces_touch_and_part(law: FeltLaw) -> None:
    time_s = np.linspace(0.0, 0.02, 200_001)
    depth = DEEP * np.sin(2.0 * np.pi * 100.0 * time_s)  # two touches, two partings
    force = law.response(time_s, depth).force_n
    assert force[depth <= 0.0] == pytest.approx(0.0, abs=1e-300)
    assert np.abs(np.diff(force)).max() < 2e-3 * force.max()


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: HuntCrossley(-1.0, 0.0, 1e4, 0.1), "a found -1"),
        (lambda: HuntCrossley(1e10, -1e9, 1e4, 0.1), "b found"),
        (lambda: HuntCrossley(1e10, 0.0, 1e4, -0.1), "D found"),
        (lambda: Stulov(1e10, 2.5, 1.0, 1e-3), "epsilon found 1"),
        (lambda: Stulov(1e10, 2.5, 0.5, 0.0), "tau0 found 0"),
        (lambda: Hysteresis(*CUBIC, (0.6, 0.6), (0.1, 0.2)), "sum of beta found 1.2"),
        (lambda: Hysteresis(*CUBIC, (0.1,), (0.5,)), "eta found 0.5"),
        (lambda: Hysteresis(*CUBIC, (0.1,), ()), "1 beta and 0 eta"),
        (lambda: HuntCrossley(*CUBIC, 0.1).response([0.0, 0.0], [0.0, 1.0]), "times that increase"),
        (lambda: HuntCrossley(*CUBIC, 0.1).response([0.0, 1.0], [0.0]), "two rows of one length"),
    ],
)
def test_what_no_felt_does_is_refused(make: object, words: str) -> None:
    with pytest.raises(InputError, match=words):
        make()  # type: ignore[operator]
