"""By how much further trials, or a sensor known better, would shrink the standard uncertainty of each parameter.

From the Fisher information at the identified values: the covariance of the fit with the columns of the new trials
beside those it has (`noise.Marginal`), sizes of noise as learnt. A further session has a discrepancy of its own, as
large as those learnt so far. The best strokes are played by the model (`rehearsal`), for which the sizes are learnt
again. How far these may yet move is told as an interval (`of_sizes`); how far the values move it cannot know: it is a
prediction of u, not of the value.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from model.errors import ModelError
from validation.conventions import Array
from validation.identification.blocks import INSTRUMENT, Block, make_blocks
from validation.identification.fit import Fitted
from validation.identification.further.rehearsal import Play, rehearsed
from validation.identification.further.shelf import Candidate
from validation.identification.noise import NOT_SEEN, Marginal
from validation.identification.noise.learning import scores
from validation.identification.observations import ObservedTrial
from validation.identification.problem import Problem
from validation.identification.runs.exact_runs import ExactRuns
from validation.identification.runs.model_runs import Response
from validation.identification.unknowns.priors import FORCE_DELAY, FORCE_GAIN, FORCE_LEVEL

TRIALS = 5
TOLD, MOST_TOLD = 3, 8  # strokes that are rehearsed: at least; until the best of all is one of them, at most
OF_ANOTHER_KIND = 0.2
"""Standard deviation of the logarithm of a shrink by a kind of stroke not played so far, beside all that is computed:
measured (`benchmarks/record_next_sizes.py`, seed 1 and the first six experiments of seed 2)."""
NORMAL = 1.96
HALF_KNOWN = 0.5
SENSORS = {
    "load cell's gain": (FORCE_GAIN,),
    "load cell's preload": (FORCE_LEVEL,),
    "load cell's delay": (FORCE_DELAY,),
    "key encoder": ("key encoder scale", "key encoder zero"),
    "whippen encoder": ("whippen encoder scale", "whippen encoder zero"),
    "hammer encoder": ("hammer encoder scale", "hammer encoder zero"),
}
Respond = Callable[[Sequence[ObservedTrial]], Response]


@dataclass(frozen=True)
class Prospect:
    """One thing that could be done next.

    Attributes
    ----------
    name : in words
    shrink : name of a parameter -> its u after, divided by its u now
    candidate : the stroke to record; None for a sensor
    trials : how many of it
    u_sizes : name of a parameter -> standard deviation of the logarithm of its shrink, from what the new strokes may
        teach about the sizes of noise, from how far the rehearsal is from the Fisher information, and
        `OF_ANOTHER_KIND`; empty where the stroke was not rehearsed
    fisher : the shrink by the Fisher information alone; empty where the stroke was not rehearsed
    """

    name: str
    shrink: Mapping[str, float]
    candidate: Candidate | None = None
    trials: int = 0
    u_sizes: Mapping[str, float] = field(default_factory=dict)
    fisher: Mapping[str, float] = field(default_factory=dict)

    def range(self, name: str) -> tuple[float, float]:
        """95 % interval of a parameter's shrink."""
        far = float(np.exp(NORMAL * self.u_sizes.get(name, 0.0)))
        return self.shrink[name] / far, self.shrink[name] * far

    @property
    def mean(self) -> float:
        """Geometric mean of the shrinks: what the prospects are ranked by, the smallest first."""
        return float(np.exp(np.mean(np.log(list(self.shrink.values())))))


def prospects(
    problem: Problem,
    fitted: Fitted,
    candidates: Sequence[Candidate],
    trials: int = TRIALS,
    respond: Respond | None = None,
) -> tuple[list[Prospect], list[str]]:
    """What each candidate and each sensor known twice as well would do, the best first.

    Parameters
    ----------
    problem, fitted : the identification
    candidates : strokes that could be recorded; more of each session's own kind are added
    trials : how many of each
    respond : what makes the model's response to some trials; by default the project's model

    Returns
    -------
    prospects, refused : lists
    """
    make = respond or (lambda some: ExactRuns(problem.action, problem.unknowns.moved, some))
    names = [p.name for p in problem.unknowns.asked]
    found: list[Prospect] = []
    made: dict[str, Block] = {}
    again: set[str] = set()
    refused: list[str] = []

    def ratio(marginal: Marginal) -> dict[str, float]:
        now, then = (np.sqrt(np.diag(m.covariance)[: len(names)]) for m in (fitted.marginal, marginal))
        return {name: float(x) for name, x in zip(names, then / now, strict=True)}

    blocks = fitted.marginal.blocks
    own = {b.session: (t, b) for t, b in zip(problem.trials[::-1], blocks[::-1], strict=True)}
    for t, b in own.values():
        more = Candidate(f"more of {t.label.rpartition(', trial')[0]}", t)
        made[more.name] = b
        again.add(more.name)
        found.append(Prospect(more.name, ratio(further(fitted, b, trials)), more, trials))
    for one in candidates:
        try:
            block = block_of(problem, fitted.z, one.trial, make)
        except ModelError as error:
            refused.append(f"{one.name}: {error}")
            continue
        made[one.name] = block
        found.append(Prospect(one.name, ratio(further(fitted, block, trials)), one, trials))
    for sensor, columns in SENSORS.items():
        found.append(Prospect(f"{sensor} known twice as well", ratio(_known_better(problem, fitted, columns))))

    def told(p: Prospect) -> Prospect:
        """A stroke as it is after a rehearsal, with limits."""
        assert p.candidate is not None
        block = made[p.name]
        planned = further(fitted, block, trials)
        then = rehearsed(fitted, planned, block, _player(problem, p.candidate.trial, make), trials) or planned
        shrink = ratio(then)
        apart = [np.log(shrink[name] / p.shrink[name]) for name in names]
        other = 0.0 if p.name in again else OF_ANOTHER_KIND
        u = np.sqrt(of_sizes(fitted, then)[: len(names)] ** 2 + np.square(apart) + other**2)
        return replace(p, shrink=shrink, fisher=p.shrink, u_sizes=dict(zip(names, u.tolist(), strict=True)))

    return _with_the_best_told(found, told), refused


def _with_the_best_told(found: Sequence[Prospect], told: Callable[[Prospect], Prospect]) -> list[Prospect]:
    """Prospects, the best first; the best strokes as rehearsed, until one of these is the best of all strokes."""
    ranked = sorted(found, key=lambda p: p.mean)
    done = 0
    while True:
        strokes = [i for i, p in enumerate(ranked) if p.candidate is not None]
        waiting = [i for i in strokes if not ranked[i].u_sizes]
        enough = done >= TOLD and bool(ranked[strokes[0]].u_sizes)
        if not waiting or enough or done >= MOST_TOLD:
            return ranked
        ranked[waiting[0]] = told(ranked[waiting[0]])
        ranked.sort(key=lambda p: p.mean)
        done += 1


def _player(problem: Problem, trial: ObservedTrial, make: Respond) -> Play:
    """What the model does in one stroke, with what moves and fixed laws elsewhere."""
    held = problem.unknowns.held[: problem.held[0].shape[2] if problem.held else 0]
    runs = ExactRuns(problem.action, (*problem.unknowns.moved, *held), [trial]) if held else make([trial])

    def play(points: Sequence[Array]) -> list[Array | None]:
        return [None if curves is None else curves[0] for curves in runs.curves(points)]

    return play


def of_sizes(fitted: Fitted, marginal: Marginal) -> Array:
    """Standard deviation (p,) of the logarithm of u after, from how far the sizes of noise may move with new strokes.

    What the strokes so far do not know of the sizes, less what will still not be known, is how far they may move; what
    that does to a u is the size's share in its variance.
    """
    sizes, now, then = marginal.sizes, scores(fitted.marginal).information, scores(marginal)
    old = fitted.marginal.sizes
    f, c, k = len(sizes.by_family), sizes.channels, sizes.common.shape[1]
    n, s = len(sizes.own), len(old.own)
    place = np.concatenate(
        [np.arange(f), f + np.arange(s * c), f + n * c + np.arange(s * k)]  # of families, own, common of old sessions
    )
    known = np.zeros_like(then.information)
    known[np.ix_(place, place)] = now
    believed = np.diag(1.0 / sizes.belief()[1] ** 2)
    moves = np.linalg.inv(known + believed) - np.linalg.inv(then.information + believed)
    return np.asarray(np.sqrt(np.maximum(np.einsum("pi,ij,pj->p", then.shares, moves, then.shares), 0.0)))


def block_of(problem: Problem, z: Array, trial: ObservedTrial, respond: Respond) -> Block:
    """The linear model of a trial that has not been recorded."""
    response = respond([trial])
    jacobian = response.jacobian(z, range(z.size))
    held: tuple[Array, ...] = ()
    if problem.held:
        runs = ExactRuns(problem.action, problem.unknowns.held, [trial])
        held = tuple(runs.jacobian(np.zeros(len(problem.unknowns.held)), range(len(problem.unknowns.held))))
    return make_blocks([trial], jacobian, response.force_columns(z), problem.laws[: z.size], held)[0]


def further(fitted: Fitted, block: Block, trials: int) -> Marginal:
    """The model of the fit with so many more trials like one, in a session of their own."""
    sizes, new = fitted.marginal.sizes, len(fitted.marginal.sizes.common)
    more = replace(sizes, own=_with_typical(sizes.own), common=_with_typical(sizes.common))
    return Marginal([*fitted.marginal.blocks, *trials * [replace(block, session=new)]], more)


def _with_typical(of_sessions: Array) -> Array:
    """Sizes by session and channel with a row for one more session: the root mean square of those that have one."""
    there = np.maximum((of_sessions > NOT_SEEN).sum(axis=0), 1)
    return np.vstack([of_sessions, np.sqrt((of_sessions**2).sum(axis=0) / there)])


def _known_better(problem: Problem, fitted: Fitted, columns: Sequence[str]) -> Marginal:
    """The model of the fit with errors of sensors half as large: of the force, which it moves, and of encoders."""
    moved = np.array([HALF_KNOWN if p.name in columns else 1.0 for p in problem.unknowns.moved])
    instrument = np.array([HALF_KNOWN if name in columns else 1.0 for name in INSTRUMENT])
    blocks = [replace(b, moved=b.moved * moved, instrument=b.instrument * instrument) for b in fitted.marginal.blocks]
    return Marginal(blocks, fitted.marginal.sizes)
