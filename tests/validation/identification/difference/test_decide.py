"""Which sets of changes are named: made-up responses of known truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pytest

from validation.conventions import Array
from validation.identification.blocks import Block
from validation.identification.difference.explain import Explained, contrasts, decide
from validation.identification.difference.responses import Candidate, Point
from validation.identification.difference.search import Evidence, Followed, Search

M, TRIALS, SHAPES = 20, 3, 12
TIME = np.linspace(0.0, 0.2, M)
LISTED = tuple(Candidate(f"law {j}", "1", (f"law{j}",), 0.3, 1e-3, law=True) for j in range(SHAPES))


def shapes() -> Array:
    """Derivatives (3 M, SHAPES): the last acts as the one before, but for a factor."""
    rng = np.random.default_rng(2)
    x = np.array([np.cumsum(rng.standard_normal((3, M)), axis=1).ravel() for _ in range(SHAPES)]).T * 2e-3
    x[:, -1] = 0.5 * x[:, -2]
    return x


@dataclass
class Bending:
    """Curves that bend with their parameters, as `Responses`."""

    measured: Array
    listed: tuple[Candidate, ...] = LISTED

    @staticmethod
    def curve(amounts: dict[int, float]) -> Array:
        """Predicted curve (3 M,)."""
        total = shapes() @ np.array([amounts.get(j, 0.0) for j in range(SHAPES)])
        return np.asarray(total + 3.0 * total**2)

    def differences(self, points: Sequence[Point]) -> list[Array | None]:
        """As in `Responses`."""
        return [self.measured - self.curve(dict(p.amounts)) for p in points]

    def columns(self, asked: Sequence[tuple[Point, int]], here: Sequence[Array]) -> list[Array]:
        """As in `Responses`, exact."""
        out = []
        for point, j in asked:
            total = shapes() @ np.array([dict(point.amounts).get(k, 0.0) for k in range(SHAPES)])
            out.append(shapes()[:, j] * (1.0 + 6.0 * total))
        return out


def said(truth: dict[int, float], lacking: float = 0.0, seed: int = 1) -> Explained:
    """What is said of trials with such a truth."""
    rng = np.random.default_rng(seed)
    extra = lacking * np.sin(40 * np.tile(TIME, 3)) * np.repeat([1.0, -2.0, 0.5], M)
    noise = 2e-5 * rng.standard_normal((TRIALS, 3 * M))
    responses = Bending(Bending.curve(truth) + extra + noise)
    (each,) = responses.differences([Point()])
    assert each is not None
    nothing = Followed((), np.zeros(0), each.mean(axis=0), each, np.zeros((3 * M, 0)))

    def around(at: Followed, before: Search | None) -> Search:
        columns = np.column_stack(responses.columns([(at.point, j) for j in range(SHAPES)], []))
        size = np.full((3, M), 5e-3)
        nil = np.zeros((3 * M, 0))
        block = Block(0, TIME, columns, nil, nil, nil, np.full(3 * M, 4e-10), size, np.zeros(M))
        laws = np.zeros(SHAPES, dtype=bool)
        evidence = Evidence(block, laws, 1e-3 * np.eye(SHAPES), contrasts(at.each))
        return Search(responses, evidence, nothing, (columns, nil))  # type: ignore[arg-type]

    return decide(around, nothing, "trials 1, 2, 3")


def named(found: Explained) -> set[frozenset[str]]:
    """Names of each set."""
    sets: dict[int, set[str]] = {}
    for row in found.changes:
        sets.setdefault(row.set, set()).add(row.cause)
    return {frozenset(one) for one in sets.values()}


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_one_change_is_named_alone_with_its_size_where_no_other_explains_it(seed: int) -> None:
    found = said({3: 1.2}, seed=seed)
    assert named(found) == {frozenset({"law 3"})}
    (row,) = found.changes
    assert abs(np.log(row.change) - 0.3 * 1.2) < 3 * row.u and row.u < 0.02
    assert "this change explains the difference of trials 1, 2, 3" in found.sentence and "law 3 × 1.4" in found.sentence


def test_all_that_act_alike_are_named_and_none_alone() -> None:
    found = said({SHAPES - 2: 0.9})
    assert named(found) == {frozenset({f"law {SHAPES - 2}"}), frozenset({f"law {SHAPES - 1}"})}
    assert "cannot tell them apart" in found.sentence
    sizes = {row.cause: np.log(row.change) for row in found.changes}
    assert sizes[f"law {SHAPES - 1}"] == pytest.approx(2 * sizes[f"law {SHAPES - 2}"], rel=0.05)


@pytest.mark.parametrize("truth", [{1: 1.0, 5: -0.8}, {0: -0.7, 4: 0.9, 8: 1.1}])
def test_changes_that_explain_it_only_together_are_named_together(truth: dict[int, float]) -> None:
    found = said(truth)
    assert named(found) == {frozenset(f"law {j}" for j in truth)}
    assert f"these {len(truth)} changes together explain" in found.sentence


def test_none_is_named_where_the_model_lacks_something_or_more_have_changed() -> None:
    for found in (said({3: 1.0}, lacking=4e-3), said({0: 0.9, 2: -0.8, 4: 1.0, 6: -1.1, 8: 0.7})):
        assert not found.changes
        assert "no part of the model explains the difference" in found.sentence


def test_nothing_need_have_changed_within_the_noise() -> None:
    found = said({})
    assert not found.changes and "no part of the model need have changed" in found.sentence


def test_contrasts_hold_what_trials_differ_by_and_not_their_mean() -> None:
    each = np.random.default_rng(0).standard_normal((4, 5))
    apart = contrasts(each)
    assert apart == pytest.approx(contrasts(each + 7.0))
    assert np.sum(apart**2) == pytest.approx(np.sum((each - each.mean(axis=0)) ** 2))
    assert contrasts(each[:1]).shape == (0, 5)


def test_evidence_of_a_set_is_that_of_its_joint_density() -> None:
    """Against the density of the stacked trials with one size of the noise."""
    rng = np.random.default_rng(4)
    columns = shapes()[:, :2]
    block = Block(
        0, TIME, columns, np.zeros((3 * M, 0)), np.zeros((3 * M, 0)), np.zeros((3 * M, 0)), np.full(3 * M, 1e-8),
        np.full((3, M), 1e-9), np.zeros(M),
    )  # fmt: skip
    each = rng.standard_normal((TRIALS, 3 * M)) * 1e-4 + columns @ np.array([0.5, 0.1])
    evidence = Evidence(block, np.zeros(2, dtype=bool), np.zeros((2, 2)), contrasts(each))

    def density(which: list[int]) -> float:
        x = columns[:, which]
        v = np.kron(np.ones((TRIALS, TRIALS)), x @ x.T) + 1e-8 * np.eye(3 * M * TRIALS)
        r = each.ravel()
        return -0.5 * float(r @ np.linalg.solve(v, r) + np.linalg.slogdet(v)[1])

    mean = each.mean(axis=0)
    both, none = (evidence.log_evidence(mean, columns[:, which]) for which in ([0, 1], []))
    assert both - none == pytest.approx(density([0, 1]) - density([]), rel=1e-4)
