"""Morris's screening on functions whose effects are known."""

from __future__ import annotations

import numpy as np
import pytest

import model
from model.screening import Spread, morris, spreads
from model.screening.morris import LEVELS, MOST_WAYS, check_ways, design
from model.sensitivity import Parameter


def normal(count: int) -> list[Spread]:
    return [Spread(Parameter(f"x{i}", 5.0, "1", {}, 1e-6, 1.0), 0.5, 3.5, 6.5) for i in range(count)]


def test_ways_change_one_parameter_at_a_time_by_half_the_grid() -> None:
    points = design(7, 20, np.random.default_rng(1))
    assert points.shape == (20, 8, 7) and np.all((points > 0.0) & (points < 1.0))
    moves = np.diff(points, axis=1)
    assert np.all(np.sum(moves != 0.0, axis=2) == 1)
    assert np.all(np.sum(moves != 0.0, axis=1) == 1)  # each parameter once a way
    np.testing.assert_allclose(np.abs(moves[moves != 0.0]), 2.0 / LEVELS)
    assert 0.3 < np.mean(moves[moves != 0.0] > 0.0) < 0.7


def test_linear_effects_are_exact() -> None:
    slope = np.array([3.0, -2.0, 0.0])
    found = morris(normal(3), lambda x: (x @ slope)[:, None] + 7.0, ("y",), ways=5)
    np.testing.assert_allclose(found.mu[0], 0.5 * slope, atol=1e-12)
    np.testing.assert_allclose(found.mu_star[0], 0.5 * np.abs(slope), atol=1e-12)
    np.testing.assert_allclose(found.sigma[0], 0.0, atol=1e-12)
    np.testing.assert_allclose(found.mu_star_low, found.mu_star_high, atol=1e-12)


def test_curved_and_mixed_effects_have_a_sigma() -> None:
    found = morris(
        normal(3), lambda x: np.column_stack([(x[:, 0] - 5.0) ** 2, (x[:, 0] - 5.0) * (x[:, 1] - 5.0)]), ("a", "b"), 50
    )
    assert abs(found.mu[0, 0]) < 0.1 < found.sigma[0, 0]  # goes both ways: the mean says nothing, sigma does
    assert found.mu_star[1, 0] > 0.05 and found.mu_star[1, 1] > 0.05 and found.mu_star[1, 2] == 0.0
    assert found.mu_star_low[1, 0] < found.mu_star[1, 0] < found.mu_star_high[1, 0]


def test_missing_quantities_are_left_out_and_counted() -> None:
    def compute(x: np.ndarray) -> np.ndarray:
        y = x[:, :1].copy()
        y[x[:, 1] > 5.3] = np.nan
        return np.column_stack([y, np.full(len(y), np.nan)])

    found = morris(normal(2), compute, ("some", "never"), ways=20, seed=2)
    assert found.mu_star[0, 0] == pytest.approx(0.5) and 0.0 < found.absent[0] < 1.0
    assert np.all(np.isnan(found.mu_star[1])) and found.absent[1] == 1.0


def test_ways_are_two_to_the_most() -> None:
    check_ways(MOST_WAYS)
    with pytest.raises(model.InputError, match="found 1, allowed 2 to"):
        morris(normal(2), lambda x: x[:, :1], ("y",), ways=1)


def test_spreads_are_declared_or_given_and_stay_within_what_is_allowed(action: model.Action) -> None:
    mass, law, damping = spreads(
        action, ["hammer.mass", "friction", "contact04.normal.D"], {"friction": 0.1, "contact04.normal.D": 1e3}
    )
    assert mass.u == action.quantities["hammer.mass"].u and law.u == 0.1
    assert mass.low == pytest.approx(action["hammer.mass"] - 3.0 * mass.u)
    assert mass.at(np.array([0.5]))[0] == pytest.approx(action["hammer.mass"], rel=1e-12)
    assert damping.low > 0.0 and damping.high < 1e3  # allowed 0 to 1000 s/m
    drawn = law.at(np.random.default_rng(0).random(20_000))
    assert np.std(drawn) == pytest.approx(0.1, rel=0.03) and np.all((drawn >= law.low) & (drawn <= law.high))


@pytest.mark.parametrize(
    ("names", "given", "words"),
    [
        (["friction"], {}, "friction: no declared uncertainty"),
        (["hammer.mass"], {"key.mass": 1.0}, "key.mass: not among the parameters"),
        (["hammer.mass"], {"hammer.mass": -1.0}, "found -1, allowed above 0"),
        (["hammer.mas"], {}, "did you mean hammer.mass"),
    ],
)
def test_spreads_that_cannot_be(action: model.Action, names: list[str], given: dict[str, float], words: str) -> None:
    with pytest.raises(model.InputError, match=words):
        spreads(action, names, given)
