"""The joint uncertainty of an identified set in the draws of a comparison."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import model
from validation import ValidationInputError
from validation.prediction.input_sampling import parameter_draws, uncertain_parameters
from validation.prediction.posterior import Posterior, make_posterior, posterior_of

PAIR = ("hammer.joint_friction.A", "contact07.friction.A")
PRIOR = 0.3


def identified(covariance: np.ndarray, **changed: Any) -> model.Action:
    """The built-in action with this covariance of two frictions."""
    found = make_posterior([(name, (name,), PRIOR, True) for name in PAIR], covariance, {"try, trial 1": "seal"})
    table = found.table() | changed
    return replace(
        model.load_action(),
        identification={"posterior": table, "provenance": {"trials_sha256": {"try, trial 1": "seal"}}},
    )


def logarithms(action: model.Action, n: int = 1200) -> np.ndarray:
    """Drawn logarithms of the two frictions, (n, 2)."""
    drawn = parameter_draws(action, n, np.random.default_rng(4))
    return np.log([[one[name] for name in PAIR] for one in drawn])


@pytest.mark.parametrize("correlation", [-0.97, 0.6])
def test_a_correlated_pair_gives_the_band_of_its_covariance(correlation: float) -> None:
    z_u = np.array([0.8, 0.5])
    covariance = np.outer(z_u, z_u) * np.array([[1.0, correlation], [correlation, 1.0]])
    drawn = logarithms(identified(covariance))
    for weights in ((1.0, 0.0), (0.0, 1.0), (1.0, 1.0), (1.0, -1.0), (0.5, 0.8)):
        right = PRIOR * float(np.sqrt(np.array(weights) @ covariance @ np.array(weights)))
        assert np.std(drawn @ np.array(weights)) == pytest.approx(right, rel=0.08), weights


def test_an_independent_pair_gives_the_band_of_independent_draws() -> None:
    declared = {
        name: replace(q, u=0.05 * q.value) if name in PAIR else q for name, q in model.load_action().quantities.items()
    }
    old = replace(model.load_action(), quantities=declared)
    new = identified(np.eye(2) * (0.05 / PRIOR) ** 2)
    one, other = logarithms(old), logarithms(new)
    for weights in ((1.0, 1.0), (1.0, -1.0)):
        assert np.std(other @ np.array(weights)) == pytest.approx(np.std(one @ np.array(weights)), rel=0.08)


def test_identified_parameters_are_drawn_once_and_the_rest_as_before() -> None:
    action = identified(np.array([[0.2, 0.1], [0.1, 0.3]]))
    old = model.load_action()
    alone = {**uncertain_parameters(action, assumed=False), **uncertain_parameters(action, assumed=True)}
    before = {**uncertain_parameters(old, assumed=False), **uncertain_parameters(old, assumed=True)}
    assert not set(PAIR) & set(alone) and set(alone) | set(PAIR) == set(before)
    (drawn,) = parameter_draws(action, 1, np.random.default_rng(1))
    assert set(drawn) == set(before)
    same = parameter_draws(old, 3, np.random.default_rng(1))
    assert same == parameter_draws(replace(old, identification={"names": []}), 3, np.random.default_rng(1))


def test_what_is_written_is_read_back_with_its_covariance() -> None:
    rng = np.random.default_rng(2)
    half = rng.standard_normal((5, 5)) / 4
    covariance = np.eye(5) - half @ half.T / np.linalg.norm(half @ half.T, 2) * 0.99
    names = [p for p in model.load_action().quantities if p.endswith(".joint_friction.A")]
    made = make_posterior([(n, (n,), 0.3, True) for n in names], covariance, {})
    read = posterior_of(
        replace(model.load_action(), identification={"posterior": made.table(), "provenance": {"trials_sha256": {}}})
    )
    assert isinstance(read, Posterior)
    np.testing.assert_allclose(read.covariance, covariance, atol=1e-5)


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"left": [0.1]}, "found damaged"),
        ({"left": [-0.1, 0.2]}, "allowed from 0"),
        ({"directions": [[1.0, 0.5], [0.0, 1.0]]}, "not orthonormal"),
        ({"paths": [["hammer.joint_friction.B"], ["contact07.friction.A"]]}, "is unknown"),
        ({"u": [0.3]}, "different lengths"),
    ],
)
def test_a_damaged_table_is_refused_in_one_line(changed: dict[str, Any], said: str) -> None:
    action = identified(np.array([[0.2, 0.1], [0.1, 0.3]]), **changed)
    with pytest.raises(ValidationInputError, match=said) as raised:
        posterior_of(action)
    assert "\n" not in str(raised.value) and "[identification.posterior]" in str(raised.value)
