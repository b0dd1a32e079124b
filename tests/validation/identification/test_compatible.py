"""Which part of the model explains the difference: all smallest sets that do, none where none does."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.validation.identification import toy
from validation.identification.fit import fit
from validation.identification.page.compatible import Explanation, explain, explain_fit, in_words, log_odds


def of(truth: tuple[float, float, float], alike: bool = False, lacking: float = 0.0) -> tuple[Explanation, str]:
    """The explanation of a toy whose truth is known."""
    p = toy.problem(toy.made(np.array(truth), 4, np.random.default_rng(3), scatter=0.02, lacking=lacking), alike=alike)
    found = explain_fit(p, fit(p))
    return found, in_words(found, p)


def names(found: Explanation) -> set[frozenset[str]]:
    """Names of each set."""
    return {frozenset(c.name for c in one) for one in found.sets}


def test_one_law_that_differs_is_named_with_its_size() -> None:
    found, said = of((1.2, 0.0, 0.0))
    assert names(found) == {frozenset({toy.ASKED[0]})}
    (change,) = found.sets[0]
    assert abs(change.z - 1.2) < 3 * change.z_u and change.z_u < 0.1
    assert said.startswith("One change explains the difference between model and strokes: key.joint_friction.A × 1.4")


def test_two_that_act_alike_are_both_named() -> None:
    found, said = of((0.0, 0.9, 0.0), alike=True)
    assert names(found) == {frozenset({toy.ASKED[1]}), frozenset({toy.ASKED[2]})}
    assert "Each of these changes alone explains" in said and "cannot tell them apart" in said
    sizes = {one[0].name: one[0].z for one in found.sets}
    assert sizes[toy.ASKED[2]] == pytest.approx(sizes[toy.ASKED[1]] / 0.6, rel=0.15)


def test_two_that_differ_are_named_together_and_none_alone() -> None:
    found, said = of((1.2, -0.9, 0.0))
    assert names(found) == {frozenset(toy.ASKED[:2])}
    assert "2 changes together explain" in said


def test_nothing_is_named_where_nothing_differs() -> None:
    found, said = of((0.0, 0.0, 0.0))
    assert found.size == 0 and not found.sets and said.startswith("Nothing need have changed")


def test_none_is_named_where_the_model_lacks_something() -> None:
    found, said = of((1.2, 0.0, 0.0), lacking=2e-2)
    assert not found.sets and said.startswith("None of its parts explains") and "differ from the model alike" in said
    p = toy.problem(toy.made(np.array([1.2, 0.0, 0.0]), 2, np.random.default_rng(3)))
    assert "did not settle" in explain_fit(p, replace(fit(p), converged=False)).why_none


def test_many_that_changed_together_are_not_named_singly() -> None:
    listed = [f"law {i}" for i in range(20)]
    z = np.where(np.arange(20) < 5, 1.5, 0.0)
    found = explain(listed, z, 1e-3 * np.eye(20))
    assert not found.sets and "more than 3 laws" in found.why_none
    three = explain(listed, np.where(np.arange(20) < 3, 1.5, 0.0), 1e-3 * np.eye(20))
    assert names(three) == {frozenset(listed[:3])}


def test_evidence_is_that_of_the_restricted_model() -> None:
    """Against the evidence of a linear model fitted with and without a column."""
    rng = np.random.default_rng(5)
    x, noise = rng.standard_normal((30, 2)), 0.5
    y = x @ np.array([0.8, 0.1]) + noise * rng.standard_normal(30)

    def evidence(columns: list[int]) -> float:
        k = x[:, columns] @ x[:, columns].T + noise**2 * np.eye(30)
        return -0.5 * float(y @ np.linalg.solve(k, y) + np.linalg.slogdet(k)[1])

    covariance = np.linalg.inv(x.T @ x / noise**2 + np.eye(2))
    z = covariance @ x.T @ y / noise**2
    assert log_odds(z, covariance, frozenset({1})) == pytest.approx(evidence([0]) - evidence([0, 1]))
    assert log_odds(z, covariance, frozenset({0, 1})) == pytest.approx(evidence([]) - evidence([0, 1]))
