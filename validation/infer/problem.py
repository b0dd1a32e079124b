"""What is fitted to what, and the linear model of it where a fit stands."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

import model
from validation.conventions import Array
from validation.infer.blocks import Block, make_blocks, residuals
from validation.infer.noise import family_of
from validation.infer.observations import CHANNEL_NAMES, ObservedTrial
from validation.infer.response import Own, Response, remove_own
from validation.infer.unknowns import Unknowns

AFAR = 3.0  # how far z may move before columns of force noise are found again


@dataclass(frozen=True)
class Problem:
    """What is fitted to what."""

    action: model.Action  # model.Action
    unknowns: Unknowns
    trials: tuple[ObservedTrial, ...]
    response: Response
    held: tuple[Array, ...] = ()  # columns (m, 3, h) of each trial, of laws that are fixed

    @property
    def families(self) -> NDArray[np.intp]:
        """Family of everything that moves and of the h fixed laws that scatter, (p + h,); -1 for what is no law."""
        held = self.held[0].shape[2] if self.held else 0
        return np.array([family_of(p) for p in (*self.unknowns.moved, *self.unknowns.held[:held])], dtype=np.intp)

    @property
    def laws(self) -> NDArray[np.bool_]:
        """What scatters from trial to trial: laws among what moves, and the h columns of fixed ones, (p + h,) bool."""
        return self.families >= 0

    @property
    def watched(self) -> NDArray[np.intp]:
        """Indices in z of parameters that must converge: requested ones, and errors of the session's channels."""
        n = len(self.unknowns.asked)
        return np.array([j for j, p in enumerate(self.unknowns.moved) if j < n or not p.paths], dtype=np.intp)

    @property
    def seen(self) -> Array:
        """1 where a session measured a channel, else 0, (sessions, channels)."""
        places = {t.session: t.channels for t in self.trials}
        whole = range(len(CHANNEL_NAMES))
        return np.array([np.isin(whole, places.get(s, ())) for s in range(1 + max(places))], dtype=float)

    def of_trials(self, which: Sequence[int]) -> Problem:
        """Problem of the trials ``which`` (indices) alone."""
        held = tuple(self.held[k] for k in which) if self.held else ()
        return replace(
            self, trials=tuple(self.trials[k] for k in which), held=held, response=self.response.of_trials(which)
        )

    def box(self) -> tuple[Array, Array]:
        """Smallest and largest z, (p,) each."""
        pairs = [p.box(self.action) for p in self.unknowns.moved]
        return np.array([a for a, _ in pairs]), np.array([b for _, b in pairs])


class Columns:
    """The linear model where the fit stands; kept while it stands there.

    ``first`` are derivatives at z = 0 that are known, of what moves and of what drives each trial.
    """

    def __init__(self, problem: Problem, first: Sequence[Array] | None = None) -> None:
        self.problem = problem
        self._last: tuple[Array, Sequence[Own] | None, list[Block]] | None = None
        self._force: tuple[Array, list[Array]] | None = None
        self._held: Sequence[Array] = problem.held
        if first is not None:
            p = len(problem.unknowns.moved)
            self._force = np.zeros(p), [j[:, :, p:] for j in first]
            jacobian = [j[:, :, :p] for j in first]
            blocks = make_blocks(problem.trials, jacobian, self._force[1], problem.laws[:p], problem.held)
            self._last = np.zeros(p), None, blocks

    def blocks(self, z: Array, own: Sequence[Own] | None = None, near: bool = True) -> list[Block]:
        """Linear model of each trial at z (p,) and random effects ``own`` (None: zero); unless ``near`` the minimum,
        columns of force noise and of fixed laws are reused. The last answer is kept. ModelError where the model cannot
        run.

        All that moves is found afresh: old columns turn the last steps aside. Those of force noise are kept on the way
        and while z moves little: they only say how large it is, until trials have force noise of their own. Those of
        fixed laws are kept on the way.
        """
        last = self._last
        if last is not None and last[1] is own and np.array_equal(last[0], z):
            return last[2]
        problem, p = self.problem, z.size
        moved = np.inf if self._force is None or own is not None else np.max(np.abs(z - self._force[0]), initial=0.0)
        driven = self._force is None or (near and moved > AFAR)
        held = problem.held[0].shape[2] if near and own is not None and problem.held else 0
        found = problem.response.jacobian(z, range(p + held), own, driven)
        if driven:
            self._force = z.copy(), [j[:, :, p + held :] for j in found]
        if held:
            self._held = [j[:, :, p : p + held] for j in found]
        assert self._force is not None
        jacobian = [j[:, :, :p] for j in found]
        blocks = make_blocks(problem.trials, jacobian, self._force[1], problem.laws[:p], self._held)
        self._last = z.copy(), own, blocks
        return blocks


def make_problem_at_start(
    action: model.Action, unknowns: Unknowns, trials: Sequence[ObservedTrial], response: Response
) -> tuple[Problem, Columns]:
    """The problem, and its `Columns` with the linear model at z = 0 (the action's values), in one computation of
    derivatives; ModelError where the model cannot run there.

    Raises
    ------
    model.errors.ModelError
        The model cannot run there.
    """
    p, h = len(unknowns.moved), len(unknowns.held)
    found = response.jacobian(np.zeros(p), range(p + h), driven=True)
    problem = Problem(action, unknowns, tuple(trials), response, tuple(j[:, :, p : p + h] for j in found) if h else ())
    return problem, Columns(problem, [np.delete(j, range(p, p + h), axis=2) for j in found])


def residuals_there(
    problem: Problem, blocks: Sequence[Block], curves: Sequence[Array], own: Sequence[Own] | None
) -> list[Array]:
    """Residuals of curves run with random effects ``own``, with those removed by the linear model."""
    found = residuals(problem.trials, curves)
    return found if own is None else remove_own(blocks, found, own)


def linear_residuals(
    problem: Problem, blocks: Sequence[Block], curves: Sequence[Array], z: Array, own: Sequence[Own] | None = None
) -> list[Array]:
    """Residuals of the linear model at z = 0 without random effects."""
    found = residuals_there(problem, blocks, curves, own)
    return [r + b.moved @ z for r, b in zip(found, blocks, strict=True)]


def curves_at(problem: Problem, z: Array, own: Sequence[Own] | None = None) -> list[Array] | None:
    """Curves of all trials at one point; None where one of them cannot run."""
    return problem.response.curves([z], None if own is None else [own])[0]
