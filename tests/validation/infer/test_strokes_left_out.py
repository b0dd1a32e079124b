"""Jackknife over kinds of stroke: sessions that pull apart are seen, and it stands in the estimate."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.validation.infer import toy
from validation.infer.estimates import estimate_all
from validation.infer.fit import Fitted, fit
from validation.infer.problem import Problem
from validation.infer.scatter import jackknife_over_strokes


def two_kinds(other: float) -> tuple[Problem, Fitted]:
    """A fit to two sessions, the first with a truth of 0.5."""
    rng = np.random.default_rng(8)
    one = toy.made(np.array([0.5, 0.0, 0.0]), 4, rng, scatter=0.01)
    two = [replace(t, session=1) for t in toy.made(np.array([other, 0.0, 0.0]), 4, rng, scatter=0.01)]
    problem = toy.problem([*one, *two])
    return problem, fit(problem)


@pytest.mark.parametrize(("other", "least", "most"), [(0.5, 0.0, 0.05), (0.9, 0.1, 0.4)])
def test_sessions_that_pull_apart_are_seen(other: float, least: float, most: float) -> None:
    problem, fitted = two_kinds(other)
    u = jackknife_over_strokes(fitted)
    assert least <= u[0] <= most
    estimates = estimate_all(problem, fitted, (), lambda _: None)
    assert [e.u_strokes for e in estimates] == list(u[: len(estimates)])


def test_one_session_says_nothing_of_it() -> None:
    fitted = fit(toy.problem(toy.made(np.zeros(3), 3, np.random.default_rng(1))))
    assert np.isnan(jackknife_over_strokes(fitted)).all()
