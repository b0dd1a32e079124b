"""Runs of trials that are each at a place of their own: what is the same whatever drives them.

A place is a value of every parameter: what z moves, and after that laws which are fixed, but may be others in single
trials.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor
from typing import Generic, TypeVar

import numpy as np

import model
from validation.conventions import Array
from validation.identification.observations import ObservedTrial
from validation.identification.runs.own import Own
from validation.identification.unknowns.priors import Parameter

TOLERANCE = 2e-7
Member = TypeVar("Member")


class PlacedRuns(ABC, Generic[Member]):
    """See `model_runs.ModelRuns` for the parameters; a member is what the run of one trial does."""

    def __init__(
        self,
        action: model.Action,
        parameters: Sequence[Parameter],
        trials: Sequence[ObservedTrial],
        tolerance: float = TOLERANCE,
        executor: Executor | None = None,
    ) -> None:
        self.action, self.parameters, self.trials = action, tuple(parameters), tuple(trials)
        self.tolerance, self.executor = tolerance, executor

    @abstractmethod
    def cases(self, at: Array, own: Sequence[Own] | None) -> list[Member]:
        """The member of each trial where it is, (trials, n)."""

    @abstractmethod
    def run(self, members: Sequence[Sequence[Member]]) -> list[list[Array] | None]:
        """Curves of every trial in each of several cases of all trials; None where one of them cannot run."""

    def curves(self, points: Sequence[Array], own: Sequence[Sequence[Own]] | None = None) -> list[list[Array] | None]:
        """Curves at each point; see `model_runs.Response`."""
        return self.run([self.cases(self.places(z, o), o) for z, o in with_own(points, own)])

    def places(self, z: Array, own: Sequence[Own] | None) -> Array:
        """Where each trial is; see `places`."""
        return places(z, len(self.parameters), len(self.trials), own)

    def there(self, somewhere: Sequence[Array], own: Sequence[Own] | None) -> list[list[Array] | None]:
        """Curves at each of several places (trials, n)."""
        return self.run([self.cases(at, own) for at in somewhere])

    def units(self, which: Sequence[int], at: Array) -> Array:
        """What one prior standard uncertainty is of each parameter, where a trial is."""
        return np.array([self.parameters[j].per_u(self.action, float(at[j])) for j in which])


def with_own(
    points: Sequence[Array], own: Sequence[Sequence[Own]] | None
) -> Iterator[tuple[Array, Sequence[Own] | None]]:
    """Each point with what the trials have of their own there."""
    return zip(points, len(points) * [None] if own is None else own, strict=True)


def places(z: Array, n: int, trials: int, own: Sequence[Own] | None) -> Array:
    """Where each trial is, (trials, n) of all parameters; those that z does not reach are as the action has them."""
    at = np.zeros((trials, n))
    at[:, : z.size] = z
    if own is not None:
        for k, o in enumerate(own):
            at[k, : o.laws.size] += o.laws
    return at
