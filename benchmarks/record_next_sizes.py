"""How often are predicted shrinks realised, and their 95 % limits right? Many experiments, without fits.

    python -m benchmarks record_next_sizes [--sessions 20] [--first forte] [--next double] [--numbers 5,10]
                                           [--more 5] [--sensors NAMES] [--seed 1] [--results FILE] [--minutes M]

Specimen = model; five to nine laws drawn at random are free, their truth and the errors of force and encoders drawn
from their priors, all frictions scatter by 2 % from trial to trial (`benchmarks.identification_coverage`). As many
trials of the first kind as ``--numbers`` say are played; sizes of noise are learnt from them on the linear model at
the truth; shrinks are predicted as `identify --plan` does: for more trials of the same kind in a session of their own,
for another kind, and for each sensor known twice as well. Then these trials are played, sizes are learnt again, and u
after over u before is compared with what was predicted. A sensor known twice as well has half its error.

There is no fit: what it shows is how well sizes of noise are known, not where a fit ends. ``told``: parameters whose u
is to shrink by more than a tenth; all others are easily right. ``linear``: these by the Fisher information alone,
without the rehearsal (`validation.identification.further`); ``clear``: those of ``told`` where after the
first trials the model is not said to lack anything.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np

import model
from benchmarks.identification_coverage import (
    Sensors,
    drawn_truth,
    force_errors,
    freed,
    observed,
    played,
    problem_of,
)
from benchmarks.runner import Run, Table, interval, may_be
from model.errors import ModelError
from validation.conventions import Array
from validation.errors import ValidationError
from validation.identification.blocks import INSTRUMENT, Block
from validation.identification.estimates import LACKING
from validation.identification.fit import Fitted
from validation.identification.further import HALF_KNOWN, SENSORS, Candidate, Prospect, further, prospects
from validation.identification.noise import Sizes, likeliest
from validation.identification.observations import ObservedTrial
from validation.identification.problem import Columns, Problem, linear_residuals
from validation.identification.scatter import factors
from validation.identification.unknowns import Unknowns

NEAR = 0.2
SAME = ("seed", "first", "next", "numbers", "more")
FREE = (5, 9)
TOLD = 0.9
LEARNINGS = 40
CLASSES = (
    ("all", "predicted", np.inf),
    ("told", "predicted", TOLD),
    ("linear", "fisher", TOLD),
    ("clear", "predicted", TOLD),
)
Part = tuple[Problem, list[Block], list[Array]]


class Experiment:
    """One specimen, its sensors, and its trials with their linear model at the truth."""

    def __init__(self, k: int, options: Run) -> None:
        self.rng = np.random.default_rng([options.seed, k, 163])
        self.start = model.load_action()
        n = int(self.rng.integers(FREE[0], FREE[1] + 1))
        self.free: Unknowns = freed(self.start, SimpleNamespace(free=n, kinds=[options.first]), self.rng)  # type: ignore[arg-type]
        truth, self.specimen = drawn_truth(self.start, self.free, 0.5, self.rng)
        self.sensors = Sensors(self.rng)
        force = force_errors(self.sensors)
        self.z = np.array([truth[p.name] if p.paths else force[p.name] for p in self.free.moved])

    def trials(self, kind: str, session: int, n: int) -> list[ObservedTrial]:
        """Played and observed."""
        return observed(kind, session, played(self.specimen, kind, n, self.sensors, self.rng))

    def part(self, kind: str, session: int, n: int) -> Part:
        """Trials with their linear model and residuals at z = 0 of it."""
        problem = problem_of(self.start, self.free, self.trials(kind, session, n))
        (curves,) = problem.response.curves([self.z])
        if curves is None:
            raise ValidationError("the model cannot run at the true values")
        blocks = Columns(problem).blocks(self.z)
        return problem, blocks, linear_residuals(problem, blocks, curves, self.z)

    def learnt(self, problem: Problem, blocks: list[Block], linear: list[Array], sizes: Sizes | None = None) -> Fitted:
        """Sizes of noise learnt from some trials, from two starts as in a fit; one of them where they were before."""
        first = Sizes.start(problem.families, problem.seen) if sizes is None else sizes
        marginal = likeliest(blocks, linear, first, LEARNINGS)
        return Fitted(self.z, [], marginal, linear, 0.0, 0, True)

    def errors(self, trial: ObservedTrial) -> dict[str, float]:
        """True errors of the sensors, in standard uncertainties."""
        s, names = self.sensors, ("key", "whippen", "hammer")
        out = force_errors(s)
        for e, turn, change in zip(s.config.encoders, s.turn, s.change, strict=True):
            c = names.index(e.name)
            out[f"{e.name} encoder scale"] = turn / trial.u_scale[c]
            out[f"{e.name} encoder zero"] = change / trial.u_steady_rad[c]
        return out

    def better(self, fitted: Fitted, names: Sequence[str], trial: ObservedTrial) -> tuple[list[Block], list[Array]]:
        """The same trials with half the error of a sensor."""
        true, moved = self.errors(trial), [p.name for p in self.free.moved]
        blocks, linear = [], []
        for b, r in zip(fitted.marginal.blocks, fitted.linear, strict=True):
            m, i, left = b.moved.copy(), b.instrument.copy(), r.copy()
            for name in names:
                columns, j = (m, moved.index(name)) if name in moved else (i, INSTRUMENT.index(name))
                left -= (1 - HALF_KNOWN) * true[name] * columns[:, j]
                columns[:, j] *= HALF_KNOWN
            blocks.append(replace(b, moved=m, instrument=i))
            linear.append(left)
        return blocks, linear


def experiment(k: int, options: Run) -> dict[str, Any]:
    """One experiment as plain data; ``failed`` says why it has none."""
    numbers, began = options.numbers, time.process_time()
    try:
        one = Experiment(k, options)
        first = one.part(options.first, 0, max(numbers))
        later = {kind: one.part(kind, 1, options.more) for kind in dict.fromkeys((options.first, options.next))}
        dry = one.trials(options.next, 0, 1)[0]
        better = [x for x in SENSORS if x in options.sensors]
        rows = []
        for n in numbers:
            rows += predicted_and_realised(
                one, n, first, later, Candidate(options.next, dry), better if n == numbers[0] else []
            )
    except (ModelError, ValidationError) as error:
        return {"failed": str(error)}
    return {"rows": rows, "processor_s": time.process_time() - began}


def predicted_and_realised(
    one: Experiment, n: int, first: Part, later: dict[str, Part], dry: Candidate, better: Sequence[str]
) -> list[dict[str, Any]]:
    """A row for each thing that could be done after n trials of the first kind, and each parameter."""
    whole, blocks, linear = first
    problem = replace(whole, trials=whole.trials[:n], held=whole.held[:n])
    before = one.learnt(problem, blocks[:n], linear[:n])
    ranked, refused = prospects(problem, before, [dry], len(next(iter(later.values()))[0].trials))
    if refused:
        raise ValidationError("; ".join(refused))
    by_name = {p.name: p for p in ranked}
    out = []
    for (kind, (new, columns, left)), what in zip(later.items(), ("same", "other"), strict=True):
        told = next(p for name, p in by_name.items() if name == kind or (what == "same" and name.startswith("more of")))
        both = replace(problem, trials=(*problem.trials, *new.trials))
        known = further(before, columns[0], 1).sizes
        after = one.learnt(both, [*blocks[:n], *columns], [*linear[:n], *left], known)
        out += compared(what, n, told, before, after)
    for sensor in better:
        found = one.better(before, SENSORS[sensor], whole.trials[0])
        after = one.learnt(problem, *found, before.marginal.sizes)
        out += compared("sensor", n, by_name[f"{sensor} known twice as well"], before, after)
    return out


def compared(what: str, n: int, told: Prospect, before: Fitted, after: Fitted) -> list[dict[str, Any]]:
    """A row for each parameter."""
    u = [np.sqrt(np.diag(f.covariance)) for f in (before, after)]
    t = [factors(f) for f in (before, after)]
    family = [f.marginal.sizes.scatter for f in (before, after)]
    lack = [float(f.marginal.sizes.discrepancy.max()) for f in (before, after)]
    return [
        {
            "what": what, "n": n, "name": name, "predicted": shrink, "fisher": told.fisher.get(name, shrink),
            "limits": told.range(name), "realised": u[1][j] / u[0][j], "u": u[0][j], "t": [t[0][j], t[1][j]],
            "scatter": [f[j] for f in family], "lacking": lack,
        }
        for j, (name, shrink) in enumerate(told.shrink.items())
    ]  # fmt: skip


def table(rows: Sequence[dict[str, Any]]) -> bool:
    """Print what is within a fifth, and inside the limits, by what is done and by the number of first trials.

    Returns whether limits may hold as often as stated.
    """
    good = True
    shown = Table(
        "next:7s", "trials:d", "of:6s", "shrinks:d", "within 20 %:d", "share:.2f", "real/told:.2f", "spread:.2f",
        "limits hold:d", "share:.2f", "99 % low:.2f", "high:.2f", "half as wide:.0%",
    )  # fmt: skip
    whole = [r for kept in rows for r in kept.get("rows", ())]
    for what, n in dict.fromkeys((r["what"], r["n"]) for r in whole):
        for name, by, most in CLASSES:
            here = [r for r in whole if (r["what"], r["n"]) == (what, n) and r["fisher"] < most]
            here = [r for r in here if name != "clear" or r["lacking"][0] <= LACKING]
            if not here or (what == "sensor" and name == "linear"):
                continue
            off = np.log([r["realised"] / r[by] for r in here])
            near = int(np.sum((off <= np.log(1 + NEAR)) & (off >= np.log(1 - NEAR))))
            limits: list[Any] = [None] * 5
            if by == "predicted" and any(r["limits"][0] < r["limits"][1] for r in here):
                hold = sum(r["limits"][0] <= r["realised"] <= r["limits"][1] for r in here)
                good &= may_be(0.95, hold, len(here))
                wide = np.median([np.log(r["limits"][1] / r["limits"][0]) / 2 for r in here])
                limits = [hold, hold / len(here), *interval(hold, len(here), 0.99), np.expm1(wide)]
            shown.row(what, n, name, len(here), near, near / len(here), np.exp(np.median(off)), np.std(off), *limits)
    print(f"experiments {len(rows)}, could not be played {sum('failed' in r for r in rows)}")
    return good


def main(run: Run) -> bool:
    """Print the table; whether limits may hold as often as stated."""
    same = [getattr(run, name) for name in SAME]
    found = run.cases([(k, *same) for k in range(run.sessions)], lambda k, *_: experiment(k, run))
    return table([row for _, row in found])
