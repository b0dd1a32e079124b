"""Mechanisms that act as one are named together, before a fit and after; what can be told is not named."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

import model
from tests.validation.infer import toy
from validation import ValidationInputError
from validation.conventions import Array
from validation.infer.identifiability import HALF, directions, warnings_of
from validation.infer.identify import check_identifiability
from validation.infer.noise import Marginal, Sizes
from validation.infer.problem import Columns, Problem
from validation.infer.unknowns import unknowns

JOINT, RUBBING = "hammer.joint_friction.A", "contact07.friction.A"
FIRST, SECOND = "contact02", "contact03"
IDLE, KEY, OTHER = "contact11.normal.D", "key.joint_friction.A", "contact05"
NAMES = (JOINT, RUBBING, FIRST, SECOND, IDLE, KEY, OTHER)


class Mechanism:
    """Curves of: two frictions of one body, two springs in series, a damping that hardly acts, two laws by themselves.

    A law is exp(0.3 z) of its value; ``arm`` is that of the contact's friction, ``soft`` the second spring's stiffness
    over the first's, ``idle`` how much of the damping shows.
    """

    def __init__(self, trials: Sequence[object], arm: float, soft: float, idle: float = 1e-5) -> None:
        self.trials, self.arm, self.soft, self.idle = trials, arm, soft, idle
        t = toy.TIME
        self.shapes = np.stack([np.sin(9 * t), np.cos(23 * t) - 1, np.sin(47 * t + 1), t, np.sin(31 * t)])
        self.weights = np.array([[1.0, 0.3, 0.5, 0.2, 0.7], [0.2, 1.0, 0.6, -0.4, 0.1], [0.4, 0.7, 1.2, 0.9, -0.8]])

    def curve(self, z: Array) -> Array:
        joint, rubbing, first, second, idle, key, other = np.exp(0.3 * z)
        give = (1 / first + 1 / (self.soft * second)) / (1 + 1 / self.soft)
        seen = np.array([(joint + self.arm * rubbing) / (1 + self.arm), give, self.idle * idle, key, other])
        return np.asarray(0.1 * np.einsum("pt,cp,p->tc", self.shapes, self.weights, seen))

    def curves(self, points: Sequence[Array], own: object = None) -> list[list[Array] | None]:
        return [[self.curve(z) for _ in self.trials] for z in points]

    def jacobian(self, z: Array, which: Sequence[int], own: object = None, driven: bool = False) -> list[Array]:
        """As in `Response`, by central differences; what drives a trial does next to nothing."""
        step = 1e-5 * np.eye(z.size)
        found = np.stack([(self.curve(z + step[j]) - self.curve(z - step[j])) / 2e-5 for j in which], axis=2)
        return [np.dstack([found, np.full((toy.M, 3, 2 * driven), 1e-7)]) for _ in self.trials]


def planted(arm: float, soft: float, idle: float = 1e-5) -> Problem:
    free = replace(unknowns(model.load_action(), NAMES, ("*",)), held=(), force=())
    made = [toy.trial(k, Mechanism([], arm, soft, idle).curve(np.zeros(7))) for k in range(5)]
    return Problem(model.load_action(), free, tuple(made), Mechanism(made, arm, soft, idle))


@pytest.mark.parametrize(("arm", "soft"), [(1.0, 1.0), (0.45, 2.5), (1.7, 0.6)])
def test_frictions_of_one_body_and_springs_in_series_are_named_and_nothing_else(arm: float, soft: float) -> None:
    problem = planted(arm, soft)
    said = check_identifiability(problem, Columns(problem))
    certain = [line for line in said if line.startswith("even if the model lacks nothing")]
    together = [line for line in certain if "cannot tell" in line]
    assert sum(JOINT in line and RUBBING in line for line in together) == 1
    assert sum(FIRST in line and SECOND in line for line in together) == 1 and len(together) == 2
    assert any(IDLE in line for line in certain) and not any(KEY in line or OTHER in line for line in said)
    blocks = Columns(problem).blocks(np.zeros(7))
    covariance = Marginal(blocks, Sizes.tight(problem.families, problem.seen)).covariance[:7, :7]
    undetermined, determined = directions(NAMES, covariance)
    weights = {frozenset(d.weights): d.weights for d in undetermined}
    assert set(weights) == {frozenset({JOINT, RUBBING}), frozenset({FIRST, SECOND}), frozenset({IDLE})}
    frictions, springs = weights[frozenset({JOINT, RUBBING})], weights[frozenset({FIRST, SECOND})]
    assert frictions[RUBBING] / frictions[JOINT] == pytest.approx(-1 / arm, rel=0.02)
    assert springs[SECOND] / springs[FIRST] == pytest.approx(-soft, rel=0.02)
    for d in determined:  # what is named as known is known as well as is said
        v = np.array([d.weights.get(name, 0.0) for name in NAMES])
        assert np.sqrt(v @ covariance @ v / (v @ v)) == pytest.approx(d.left) and d.left <= HALF
    assert len(determined) == 4


def test_a_damping_that_never_acts_is_refused_by_name() -> None:
    with pytest.raises(ValidationInputError, match=f"{IDLE}: has no effect in these strokes"):
        check_identifiability(p := planted(1.0, 1.0, 0.0), Columns(p))


def test_small_weights_are_named_with_their_digits() -> None:
    """Seen is a + 30 b: b is known, a is not, and the name says by how little b would move."""
    seen = 100.0 * np.array([[1.0, 30.0]])
    undetermined, determined = directions(("a", "b"), np.linalg.inv(np.eye(2) + seen.T @ seen))
    assert [d.words for d in undetermined] == ["a − 0.03 × b"]
    assert [d.words for d in determined] == ["b + 0.03 × a"]


def test_where_all_is_known_nothing_is_named() -> None:
    known = 0.01 * np.eye(4)
    assert directions(tuple("abcd"), known)[0] == [] and warnings_of(tuple("abcd"), known) == []


def test_a_combination_that_is_known_is_not_cut_short() -> None:
    """Seen is a + b + 0.2 c: of a + b alone a seventh of the prior u is left, not a hundredth."""
    seen = 100.0 * np.array([[1.0, 1.0, 0.2]])
    covariance = np.linalg.inv(np.eye(3) + seen.T @ seen)
    _, (known,) = directions(("a", "b", "c"), covariance)
    assert set(known.weights) == {"a", "b", "c"} and known.left == pytest.approx(1 / np.sqrt(1 + 2.04e4))


def test_before_a_fit_only_what_is_certain_is_certain() -> None:
    """A law that 5 % of discrepancy hides is said to be hidden by that, not by the strokes."""
    problem = planted(1.0, 1.0, idle=6e-3)
    said = check_identifiability(problem, Columns(problem))
    named = [line for line in said if IDLE in line]
    assert len(named) == 1 and named[0].startswith("if the model lacks 5 %")


@pytest.mark.parametrize("seed", range(20))
def test_in_random_systems_nothing_is_named_wrongly(seed: int) -> None:
    """Rows that share names at random: as many directions as are unknown, each unknown, and no name that is known."""
    rng, n = np.random.default_rng(seed), 12
    names = tuple(f"p{i}" for i in range(n))
    seen = np.zeros((int(rng.integers(4, n)), n))
    for row in seen:
        members = rng.choice(n, rng.integers(1, 5), replace=False)
        row[members] = rng.normal(size=members.size) * 10 ** rng.uniform(0.5, 2.5)
    precision = np.eye(n) + seen.T @ seen
    covariance = np.linalg.inv(precision)
    undetermined, determined = directions(names, covariance)
    unknown = int(np.sum(np.sqrt(np.linalg.eigvalsh(covariance)) > HALF))
    found = np.array([[d.weights.get(name, 0.0) for name in names] for d in undetermined]).reshape(-1, n)
    assert len(undetermined) == unknown == np.linalg.matrix_rank(found, tol=1e-6)
    known = np.sqrt(np.diag(covariance)) < 0.05
    for v in found:
        assert np.sqrt(v @ v / (v @ precision @ v)) > HALF
        assert np.all(np.abs(v[known]) < 0.1)
    for d in determined:
        v = np.array([d.weights.get(name, 0.0) for name in names])
        assert np.sqrt(v @ covariance @ v / (v @ v)) == pytest.approx(d.left, rel=1e-6) and d.left <= HALF
