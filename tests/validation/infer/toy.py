"""A made-up model with known derivatives, and trials of it with known truth, for tests of the fit."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import replace

import numpy as np

import model
from validation.conventions import Array
from validation.infer.blocks import Block, rows
from validation.infer.observations import ObservedTrial
from validation.infer.problem import Columns, Problem
from validation.infer.response import Own
from validation.infer.unknowns import Unknowns, unknowns

ASKED = ("key.joint_friction.A", "hammer.joint_friction.A", "contact07.friction.A")
M = 24
TIME = np.linspace(0.0, 0.24, M)


class Toy:
    """Curves that bend a little with each of three parameters; ``alike`` makes the last two act as one."""

    def __init__(self, trials: Sequence[ObservedTrial], alike: bool = False) -> None:
        self.trials, self.alike = trials, alike

    def parts(self, z: Array) -> Array:
        shapes = np.stack([np.sin(9 * TIME), np.cos(23 * TIME) - 1, np.sin(47 * TIME + 1)])
        weights = np.array([[1.0, 0.3, 0.5], [0.2, 1.0, 0.6], [0.4, 0.7, 1.2]])
        if self.alike:
            shapes[2], weights[:, 2] = 0.6 * shapes[1], weights[:, 1]
        return 0.01 * np.einsum("pt,cp,p->tcp", shapes, weights, z)

    def curve(self, z: Array) -> Array:
        total = self.parts(z).sum(axis=2)
        return np.asarray(0.1 * np.sin(12 * TIME)[:, None] + total + 2.0 * total**2)

    def curves(self, points: Sequence[Array], own: Sequence[Sequence[Own]] | None = None) -> list[list[Array] | None]:
        every = zip(points, len(points) * [None] if own is None else own, strict=True)
        return [[self.curve(at) for at in self.places(z, o)] for z, o in every]

    def places(self, z: Array, own: Sequence[Own] | None) -> Array:
        laws = [np.zeros(z.size) if own is None else own[k].laws[: z.size] for k in range(len(self.trials))]
        return z + np.array(laws).reshape(len(self.trials), z.size)

    def jacobian(
        self, z: Array, which: Sequence[int], own: Sequence[Own] | None = None, driven: bool = False
    ) -> list[Array]:
        """As in `Response`, exact; an offset and parts of noise do next to nothing."""
        force = np.full((M, 3, 4 * driven), 1e-7)
        every = enumerate(self.places(z, own))
        return [np.dstack([self.slope_of(k, at)[:, :, list(which)], force]) for k, at in every]

    def of_trials(self, which: Sequence[int]) -> Toy:
        some = copy(self)
        some.trials = [self.trials[k] for k in which]
        return some

    def slope_of(self, k: int, z: Array) -> Array:
        return self.slope(z)

    def slope(self, z: Array) -> Array:
        total = self.parts(z).sum(axis=2)
        return np.asarray(self.parts(np.ones(z.size)) * (1.0 + 4.0 * total[:, :, None]))


def free(fixed: Sequence[str] = ("*",)) -> Unknowns:
    """Three asked parameters, all else held."""
    return replace(unknowns(model.load_action(), ASKED, fixed), force=())


def trial(number: int, change: Array, session: int = 0) -> ObservedTrial:
    return ObservedTrial(
        label=f"toy {session}, trial {number}", session=session, number=number, force_time_s=TIME, force_n=0 * TIME,
        time_s=TIME, change_rad=change, u_white_rad=np.full(3, 1e-5), u_zero_rad=np.zeros(3),
        u_steady_rad=np.full(3, 1e-6), u_scale=np.full(3, 1e-4), preload_n=0.0, u_preload_n=0.01, u_offset_n=1e-3,
        u_gain=1e-3, u_delay_s=1e-5, noise_n=0.01,
    )  # fmt: skip


def made(
    z: Array, n: int, rng: np.random.Generator, scatter: float = 0.05, lacking: float = 0.0
) -> list[ObservedTrial]:
    """Trials of a truth whose parameters scatter from trial to trial, and which has something the model lacks."""
    toy = Toy([])
    extra = lacking * np.cumsum(rng.standard_normal((M, 3)), axis=0) / np.sqrt(M)
    out = []
    for k in range(n):
        own = z + scatter * rng.standard_normal(z.size)
        out.append(trial(k + 1, toy.curve(own) + extra + 1e-5 * rng.standard_normal((M, 3))))
    return out


def short_forte(preload_n: float) -> ObservedTrial:
    """A trial with the force of a forte, without curves."""
    time_s, force_n = model.force_table("forte")
    inside, out = time_s < 0.16, np.linspace(0.02, 0.15, 40)
    return replace(
        trial(1, np.zeros((out.size, 3))), force_time_s=time_s[inside], force_n=preload_n + force_n[inside],
        preload_n=preload_n, time_s=out,
    )  # fmt: skip


def problem(trials: Sequence[ObservedTrial], alike: bool = False) -> Problem:
    return Problem(model.load_action(), free(), tuple(trials), Toy(trials, alike))


def blocks_of(p: Problem, z: Array) -> list[Block]:
    return Columns(p).blocks(z)


def rows_of(curves: Array) -> Array:
    return rows(curves)
