"""One screw turned: what presses at rest is no measurement, and places narrower than a step of the search are found."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any, cast

import pytest

import model
from model.regulation.screws import AT_REST_CLEAR, SCREW, TOLERANCE, TOO_FAR, Bench
from model.regulation.turn_screw import turn_screw


class OneScrew:
    """A bench whose back-check wire has a known effect."""

    def __init__(self, error: Callable[[float], float]) -> None:
        self.turn_m, self.effect = {"check": 0.0}, {}
        self._error = error

    def limits(self, name: str) -> tuple[float, float]:
        return -8e-3, 8e-3

    def error(self, name: str, turn: float) -> float:
        return self._error(turn)


def turned(error: Callable[[float], float]) -> tuple[float, float]:
    bench = OneScrew(error)
    left = turn_screw(cast(Any, bench), "check", lambda text: None)
    return bench.turn_m["check"], left


def test_a_target_that_comes_near_within_one_step_of_the_search_is_met() -> None:
    """As seed 50 of benchmarks/regulation_sweep.py: nearer from both sides, a narrow place in between."""

    def narrow(turn: float) -> float:
        return 1e-3 + 1.5 * abs(turn + 1.37e-3) - (2e-3 if abs(turn + 1.37e-3) < 0.05e-3 else 0.0)

    turn, left = turned(narrow)
    assert abs(turn + 1.37e-3) < 0.06e-3 and left < 0.0  # found where it is crossed; the jump itself cannot be met


def test_a_target_that_is_met_only_beside_where_it_cannot_be_measured_is_found() -> None:
    """As seed 50 measured: up to where the hammer is no longer caught, the height comes down to 15 mm."""

    def beside_a_gap(turn: float) -> float:
        x = 1e3 * turn
        if -1.354 < x < -1.294:
            return math.nan
        return 1e-3 * min(9.0 * (-1.354 - x) if x <= -1.354 else 0.3 + 9.0 * (x + 1.294), 2.5)

    turn, left = turned(beside_a_gap)
    assert abs(left) <= TOLERANCE and turn == pytest.approx(-1.354e-3, abs=3e-6)


def test_the_nearest_place_is_kept_where_nothing_meets_the_target() -> None:
    turn, left = turned(lambda x: 0.7e-3 + 2.0 * abs(x + 1.4e-3))
    assert left == pytest.approx(0.7e-3, abs=0.1e-3) and abs(turn + 1.4e-3) < 0.07e-3


def test_a_screw_that_presses_at_rest_leads_nowhere() -> None:
    """Beyond 1.5 mm the wire holds the hammer at rest: what looks like a check there is none."""
    turn, left = turned(lambda x: -TOO_FAR if x > 1.5e-3 else 2e-3 + abs(x))
    assert turn < 1.5e-3 and left >= 2e-3
    turn, left = turned(lambda x: -TOO_FAR if x > 1.5e-3 else 3.0 * (0.4e-3 - x))
    assert abs(left) <= TOLERANCE and turn == pytest.approx(0.4e-3, abs=2e-5)


@pytest.mark.parametrize("name", list(AT_REST_CLEAR))
def test_what_holds_the_action_at_rest_has_the_error_of_a_screw_turned_too_far(name: str) -> None:
    bench = Bench(model.load_action("hirschkorn2004-regulated"))
    assert math.isfinite(bench.error(name, 0.0)) and abs(bench.error(name, 0.0)) <= TOLERANCE
    _, way = AT_REST_CLEAR[name]
    longer = replace(bench, wider_m=20e-3)
    error = longer.error(name, longer.limits(name)[0 if way > 0.0 else 1])
    assert abs(error) == TOO_FAR
    assert math.copysign(1.0, -error / SCREW[name].usual_effect) == way  # the secant turns it away
