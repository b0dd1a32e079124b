"""A fit whose runs are computed elsewhere: the same numbers, a worker lost or not."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import model
from validation.errors import ValidationInputError
from validation.infer.observations import ObservedTrial
from validation.infer.response import ModelResponse, map_jobs
from validation.infer.sources import IdentifyOptions, collect
from validation.infer.unknowns import unknowns

EXAMPLE = Path(__file__).parents[3] / "sessions" / "example_forte"
ASKED = ["hammer.joint_friction", "contact07.friction"]


class Gone(Executor):
    """Workers that are lost with whatever they are given."""

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        out: Future[Any] = Future()
        out.set_exception(BrokenProcessPool("a worker was killed"))
        return out


@pytest.fixture(scope="module")
def trials() -> list[ObservedTrial]:
    found = collect([EXAMPLE], model.load_action(), IdentifyOptions(phases=10))
    return list(found.fitted[:1])


def test_a_lost_run_is_no_model_that_cannot_run(trials: list[ObservedTrial]) -> None:
    runs = ModelResponse(model.load_action(), (), trials, executor=Gone())
    with pytest.raises(ValidationInputError, match="a run was lost where it was computed .BrokenProcessPool"):
        runs.curves([np.zeros(0)])
    free = unknowns(model.load_action(), ASKED, ["*"])
    for motion_driven in (False, True):
        seen = collect([EXAMPLE], model.load_action(), IdentifyOptions(phases=10, motion_driven=motion_driven)).fitted
        elsewhere = ModelResponse(model.load_action(), free.asked, seen[:1], executor=Gone())
        with pytest.raises(ValidationInputError, match="a run was lost"):
            elsewhere.jacobian(np.zeros(2), range(2))


def test_errors_of_the_model_stay_what_they_are() -> None:
    def refuse(job: int) -> int:
        raise model.StaticsError(f"no rest for {job}")

    class Here(Executor):
        def map(self, fn: Callable[..., Any], *iterables: Iterable[Any], **kwargs: Any) -> Any:
            return map(fn, *iterables)

    for executor in (None, Here()):
        with pytest.raises(model.StaticsError, match="no rest for 1"):
            map_jobs(executor, refuse, [1])


def test_another_process_gives_the_same_columns(trials: list[ObservedTrial]) -> None:
    free = unknowns(model.load_action(), ASKED, ["*"])
    zero = np.zeros(2)
    here = ModelResponse(model.load_action(), free.asked, trials)
    with ProcessPoolExecutor(1) as pool:
        there = ModelResponse(model.load_action(), free.asked, trials, executor=pool)
        found = [runs.jacobian(zero, range(2), driven=True)[0] for runs in (there, here)]
        np.testing.assert_array_equal(*found)
