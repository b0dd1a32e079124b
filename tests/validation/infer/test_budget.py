"""How a fit ends: settled, out of its budget, or by Ctrl-C, with the best so far."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import count

import numpy as np
import pytest

from tests.validation.infer import toy
from validation.conventions import Array
from validation.infer.budget import OUT_OF_BUDGET, Budget
from validation.infer.fit import fit_multistart
from validation.infer.problem import Problem
from validation.infer.response import Own

TRUTH = np.array([0.8, -0.5, 0.3])


def problem() -> Problem:
    return toy.problem(toy.made(TRUTH, 5, np.random.default_rng(3)))


def test_a_share_of_a_budget_ends_with_it_or_before() -> None:
    now = [0.0]
    whole = Budget(10.0, lambda: now[0])
    part = whole.fraction(0.4)
    assert (whole.left_s, part.left_s) == (10.0, 4.0)
    now[0] = 5.0
    assert part.is_spent and not whole.is_spent
    with part.interruptible():
        raise KeyboardInterrupt
    assert whole.is_spent and whole.is_interrupted


@pytest.mark.parametrize("ticks", [1, 2])
def test_a_fit_out_of_its_budget_has_the_best_so_far_and_says_what_is_missing(ticks: int) -> None:
    clock = count()
    found = fit_multistart(problem(), budget=Budget(ticks, lambda: float(next(clock))))[0]
    assert found.end.kind == OUT_OF_BUDGET and not found.converged and found.end.detail
    assert np.all(np.isfinite(found.z)) and np.all(np.linalg.eigvalsh(found.covariance) > 0.0)


def test_ctrl_c_keeps_the_best_so_far() -> None:
    class Stopped(toy.Toy):
        """A toy whose user loses patience."""

        asked = 0

        def jacobian(
            self, z: Array, which: Sequence[int], own: Sequence[Own] | None = None, driven: bool = False
        ) -> list[Array]:
            Stopped.asked += 1
            if Stopped.asked == 4:
                raise KeyboardInterrupt
            return super().jacobian(z, which, own, driven)

    p = problem()
    found = fit_multistart(replace(p, response=Stopped(p.trials)))[0]
    assert found.end.by_user and found.end.kind == OUT_OF_BUDGET and "stopped by Ctrl-C" in found.end.detail
    assert Stopped.asked <= 5 and np.any(found.z != 0.0)
