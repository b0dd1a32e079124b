"""How long an identification takes, by number of parameters and of trials, and where the time goes.

    python -m benchmarks identification_scaling [--free 3,6,12] [--trials 2,5,10] [--kinds forte] [--seed 1]
                                                [--profiles] [--results FILE]

Strokes as in `benchmarks.identification_coverage`: the specimen is the model with that many laws drawn, all else known,
five trials in a session, sessions of the kinds in turn. Where more are to be free than there are laws that act, masses
and geometry that act are free, too. Processor time in seconds, one row per fit: derivatives of the model, runs of the
model (steps, checks of derivatives), columns of what each trial has of its own (force noise), learning of the sizes of
noise, the end with each trial at its own scatter, and the rest. Processor time of all threads is counted, so that other
work on the machine does not; on an idle one with two cores the model's share takes about half of it by the clock. "off"
is the root mean square of error over u of those known to half their prior.
"""

from __future__ import annotations

import re
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from typing import Any

import numpy as np

import model
from benchmarks.identification_coverage import RUNS, Sensors, acting, acting_laws, drawn_truth, observed, played
from benchmarks.runner import Run, Table
from validation.conventions import Array
from validation.identification import fit as fitting
from validation.identification import minima
from validation.identification.estimates import estimate_all
from validation.identification.force_runs import ForceRuns, Own
from validation.identification.identify import held_columns
from validation.identification.minima import search
from validation.identification.observations import ObservedTrial
from validation.identification.problem import Problem
from validation.identification.unknowns import unknowns

IN_A_SESSION = 5
KNOWN = 0.5  # of the prior
FIXED = re.compile("normal|arc_|gravity")  # by geometry; and what is no parameter of an action
PARTS = ("derivatives", "runs", "force noise", "learning", "each trial")


class Clock:
    """Processor time by part; what is called inside a part belongs to the outermost."""

    def __init__(self) -> None:
        self.spent = dict.fromkeys(PARTS, 0.0)
        self.inside = False

    @contextmanager
    def part(self, name: str) -> Iterator[None]:
        """Count what happens here."""
        if self.inside:
            yield
            return
        self.inside, began = True, time.process_time()
        try:
            yield
        finally:
            self.inside = False
            self.spent[name] += time.process_time() - began


class Timed:
    """The model's response, its processor time counted."""

    def __init__(self, runs: ForceRuns, clock: Clock) -> None:
        self.runs, self.clock = runs, clock

    def curves(self, points: Sequence[Array], own: Sequence[Sequence[Own]] | None = None) -> list[list[Array] | None]:
        """As in `Response`."""
        with self.clock.part("runs"):
            return self.runs.curves(points, own)

    def jacobian(self, z: Array, which: Sequence[int], own: Sequence[Own] | None = None) -> list[Array]:
        """As in `Response`."""
        with self.clock.part("derivatives"):
            return self.runs.jacobian(z, which, own)

    def force_columns(self, z: Array, own: Sequence[Own] | None = None) -> list[Array]:
        """As in `Response`."""
        with self.clock.part("force noise"):
            return self.runs.force_columns(z, own)


@cache
def acting_beside(kinds: tuple[str, ...]) -> tuple[str, ...]:
    """Masses and geometry of the printed action that move an encoder in strokes of these kinds."""
    start = model.load_action()
    names = [p.name for p in unknowns(start, ["friction"]).small if p.paths and not FIXED.search(p.name)]
    return acting(start, unknowns(start, names, ["*"]).asked, kinds)


def one(free_laws: int, n: int, options: Run) -> dict[str, Any]:
    """One fit as plain data."""
    rng = np.random.default_rng([options.seed, free_laws])
    start, clock, kinds = model.load_action(), Clock(), tuple(options.kinds)
    laws = acting_laws(kinds)
    names = list(rng.choice(laws, min(free_laws, len(laws)), replace=False))
    if free_laws > len(laws):
        names += list(rng.choice(acting_beside(kinds), free_laws - len(laws), replace=False))
    free = unknowns(start, [str(name) for name in names], ["*"])
    truth, specimen = drawn_truth(start, free, 0.5, rng)
    sensors = Sensors(rng)
    trials: list[ObservedTrial] = []
    for session, first in enumerate(range(0, n, IN_A_SESSION)):
        kind = kinds[session % len(kinds)]
        data = played(specimen, kind, min(IN_A_SESSION, n - first), sensors, rng)
        trials += observed(f"{kind} {session + 1}", session, data)
    minima.refine = counted(minima.refine, clock, "each trial")
    for name in ("learn", "likeliest"):
        setattr(fitting, name, counted(getattr(fitting, name), clock))
    began = time.process_time()
    runs = Timed(ForceRuns(start, (*free.moved, *free.held), trials, RUNS), clock)
    held = held_columns(runs, free)
    before_fit = time.process_time() - began
    clock.spent["derivatives"] -= before_fit
    problem = Problem(start, free, tuple(trials), runs, held)
    fits = search(problem, 1, None, None)
    took, parts, best = time.process_time() - began, dict(clock.spent), fits[0]
    found = estimate_all(problem, best, None if options.profiles else (), lambda text: None)
    after = time.process_time() - began - took
    off = [(e.z - truth[e.name]) / e.z_u for e in found if e.z_u < KNOWN]
    return {
        "free": free_laws, "trials": n, "steps": sum(f.steps for f in fits), "settled": best.converged,
        "fixed laws": before_fit, **parts, "fit": took, "intervals": after, "fits": len(fits),
        "known": len(off), "off": float(np.sqrt(np.mean(np.square(off)))) if off else 0.0,
    }  # fmt: skip


def counted(function: Any, clock: Clock, name: str = "learning") -> Any:
    """A function of the fit whose time is that of a part."""
    plain = getattr(function, "plain", function)

    def timed(*given: Any, **named: Any) -> Any:
        with clock.part(name):
            return plain(*given, **named)

    timed.plain = plain  # type: ignore[attr-defined]
    return timed


def main(run: Run) -> bool:
    """Print the table; whether all fits settled."""
    good = True
    heads = ("free", "trials", "fits", "steps", "fit", "fixed laws", *PARTS, "rest", "intervals", "known", "off")
    whole = ("free", "trials", "fits", "steps", "known")
    table = Table(*(f"{head}:{'6d' if head in whole else '6.1f'}" for head in heads), "settled:s")
    keys = [(n, k, run.kinds, run.seed, run.profiles) for n in run.free for k in run.trials]
    for _, row in run.cases(keys, lambda n, k, *_: one(n, k, run)):
        row["rest"] = row["fit"] - row["fixed laws"] - sum(row[part] for part in PARTS)
        table.row(*(row[head] for head in heads), "yes" if row["settled"] else "NO")
        good &= row["settled"]
    return good
