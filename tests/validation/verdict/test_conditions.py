"""Conditions of a session: where the errors of its trials change, and which trials are pooled."""

from __future__ import annotations

import numpy as np
import pytest

from validation.verdict.conditions import find_change, separate_conditions
from validation.verdict.error_draws import TrialErrors
from validation.verdict.quantities import ANGLES, INDEX, QUANTITIES, relevance_limits

LIMITS = relevance_limits({})
LET_OFF = INDEX["let_off_distance"]
CAUGHT, LOOSE = 0b1101, 0b1001


def session(rng: np.random.Generator, let_off_m: list[float], branch: int = CAUGHT) -> dict[int, TrialErrors]:
    """Trials with a scatter of 0.1 mm, mrad, ms or mm/s, and an error of let-off each."""
    travel = {q.channel: 0.1 for q in ANGLES}
    values = np.ones(len(QUANTITIES) - len(ANGLES))
    out = {}
    for number, by in enumerate(let_off_m, start=1):
        errors = 1e-4 * rng.standard_normal(len(QUANTITIES))
        errors[LET_OFF] += by
        out[number] = TrialErrors(errors, {}, travel, values, branch, 0b1111)
    return out


@pytest.mark.parametrize("last", [2, 3, 5])
def test_a_step_of_let_off_is_found_where_it_is(last: int) -> None:
    change = find_change(session(np.random.default_rng(1), [*last * [0.0], *(7 - last) * [3e-3]]), LIMITS)
    assert change is not None
    assert (change.last, change.first, change.quantity.name) == (last, last + 1, "let_off_distance")
    assert change.size == pytest.approx(3e-3, abs=2e-4)
    assert change.deviations > change.limit


def test_neither_a_drift_nor_chance_nor_what_does_not_matter_is_a_change() -> None:
    rng = np.random.default_rng(3)
    assert find_change(session(rng, list(np.linspace(0.0, 6e-3, 8))), LIMITS) is None
    chance = [find_change(session(rng, 8 * [0.0]), LIMITS) for _ in range(300)]
    assert sum(change is not None for change in chance) <= 2  # 1 in a thousand
    found = session(rng, [*4 * [0.0], *4 * [0.02e-3]])
    still = {n: TrialErrors(1e-3 * t.errors, t.masks, t.travel, t.values, t.branch, t.known) for n, t in found.items()}
    assert find_change(still, LIMITS) is None
    assert find_change(session(rng, [0.0, 0.0, 9e-3]), LIMITS) is None


def test_trials_on_another_branch_change_nothing() -> None:
    rng = np.random.default_rng(4)
    found = session(rng, 7 * [0.0])
    other = {n: t for n, t in session(rng, 6 * [9e-3], LOOSE).items() if n > 4}
    assert find_change(found | other, LIMITS) is None


def test_conditions_are_cut_where_a_change_begins() -> None:
    assert separate_conditions([1, 2, 3, 4], [], []) == ()
    assert separate_conditions([1, 2, 3, 4], [], [3]) == ((1, 2), (3, 4))
    assert separate_conditions([1, 2, 3, 4, 5, 6], [(1, 3, 5), (2, 4, 6)], [5]) == ((1, 3), (5,), (2, 4, 6))
    assert separate_conditions([2, 3], [], [2]) == ()  # from the first on
