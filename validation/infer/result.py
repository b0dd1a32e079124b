"""What an identification found, as plain records: every parameter with its interval and what may be said of it.

Conventions: ``value`` is SI, or a factor of the printed stiffness where a, b and c move together; ``u`` is the standard
uncertainty of the value; intervals are 95 %. ``z`` and its uncertainty are in prior standard uncertainties.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import model
from model.arrays import ArrayRecord
from model.tabular import Tabular, axes_or_new
from rig.atomic_write import write_text
from validation.conventions import Array
from validation.infer.action_file import identified_text
from validation.infer.budget import Budget, End
from validation.infer.causes.explain import (
    MOST_TRIALS,
    Explained,
    explain_difference,
    explain_observed,
)
from validation.infer.estimates import Estimate, Profile
from validation.infer.fit import Fitted
from validation.infer.identifiability import Combination
from validation.infer.lacks import Supported, find_supported_estimates
from validation.infer.observations import ObservedTrial
from validation.infer.problem import Problem
from validation.infer.scores import EventScore
from validation.infer.sources import Sources
from validation.measurement.position_sensors import ERROR_NAMES, SensorCalibration
from validation.measurement.trial import MeasuredTrial
from validation.prediction.black_boxes import fit_black_boxes
from validation.prediction.model_under_test import ModelUnderTest
from validation.prediction.posterior import Posterior, make_posterior, posterior_of
from validation.report.files import check_target
from validation.statistics.rivals import describe_stroke, make_example

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MOST_SHOWN = 8  # estimates in `repr`
TITLE = "Which part of the model explains the difference"
NOT_LOOKED_FOR = "nothing was looked for, the difference is a few thousandths of the motion or the model cannot run"
SAMPLES = 2.5  # sampling intervals within which two times of one trial agree
BY_MOTION = f"{TITLE} is not asked where the key's motion drives the model; strokes with a recorded force tell."


def explained_lines(action: model.Action, sources: Sources) -> tuple[str, ...]:
    """Sentences on which causes explain the differences of trials and ``action`` (its values before the fit): one for
    each session that a force drives; a single one that this is not asked where none is.

    The question and the rule are those of `validate` (`validation.infer.causes`), so that page and report
    say the same of the same strokes. What the fit held or moved plays no part: everything that may be wrong is a
    candidate (docs/explanation/differences.md).
    """
    tested = ModelUnderTest(action)
    found = [(_name(trials[0][0]), _explain(tested, trials)) for trials in select_driven_by_force(sources)]
    lines = tuple(
        f"{TITLE}, {name}: {'; '.join([*(f.text for f in e.findings), e.sentence or NOT_LOOKED_FOR])}."
        for name, e in found
    )
    return lines or (BY_MOTION,)


Trials = list[tuple[ObservedTrial, MeasuredTrial | None]]


def select_driven_by_force(sources: Sources) -> list[Trials]:
    """For each session that a force drives a list of its fitted trials: as compared, and as measured (None where it was
    given as tables)."""
    observed = [t for t in sources.fitted if t.key is None]
    tables = len(observed) - len(sources.measured)  # their trials come first
    out: dict[int, Trials] = {}
    for t, m in zip(observed, (*tables * [None], *sources.measured), strict=True):
        out.setdefault(t.session, []).append((t, m))
    return list(out.values())


def _explain(tested: ModelUnderTest, trials: Trials) -> Explained:
    measured = [m for _, m in trials if m is not None]
    if measured:
        return explain_difference(tested, measured)
    observed = [t for t, _ in trials]
    return explain_observed(tested, [t for t in observed if _have_same_phases(t, observed[0])][:MOST_TRIALS])


def _have_same_phases(a: ObservedTrial, b: ObservedTrial) -> bool:
    """Whether two trials are compared at the same phases, each at the nearest of its samples."""
    sample_s = float(np.median(np.diff(b.force_time_s)))
    return a.time_s.size == b.time_s.size and float(np.ptp(a.time_s - b.time_s)) < SAMPLES * sample_s


def _name(trial: ObservedTrial) -> str:
    return trial.label.rpartition(", trial")[0] or trial.label


def sensor_calibration(problem: Problem, fitted: Fitted, sources: Sources) -> SensorCalibration | None:
    """Errors of the position sensors (amount and u of each of `ERROR_NAMES`) where the fit ended; None where no trial
    has such sensors or their errors were not fitted."""
    sensors = next((m.sensors for _, m in sources.measured_by_key if m.sensors is not None), None)
    places = {p.name: j for j, p in enumerate(problem.unknowns.moved) if p.name in ERROR_NAMES}
    if sensors is None or not places:
        return None
    at = [places[name] for name in ERROR_NAMES]
    before, width = np.array(sensors.calibration.z), np.array(sensors.calibration.u)
    z = before + width * fitted.z[at]
    u = width * np.sqrt(np.diag(fitted.covariance)[at])
    return SensorCalibration(tuple(z.tolist()), tuple(u.tolist()), sensors.sensors)


def apply_calibration(m: MeasuredTrial, sensors: SensorCalibration | None) -> MeasuredTrial:
    """Copy of a trial of position sensors with the calibration errors ``sensors``, and its key's turn read with them;
    any other trial, or without ``sensors``, as it is."""
    if m.sensors is None or sensors is None:
        return m
    new = replace(m.sensors, calibration=sensors)
    change = m.change_rad.copy()
    change[:, 0] = -new.key_turn_rad()
    return replace(m, sensors=new, change_rad=change)


def joint_posterior(
    problem: Problem,
    fitted: Fitted,
    estimates: Sequence[Estimate],
    sources: Sources,
    sensors: SensorCalibration | None = None,
) -> Posterior:
    """Joint posterior of all parameters of the action that the fit moved, errors of drive and sensors left out, widened
    to the u stated in ``estimates``; with the values before, what the strokes were like, and black boxes fitted to
    them.

    Correlations stay. With it what a comparison needs to know of the fit: the values before, what the strokes were
    like (with those of an earlier fit that these values started from), and the black boxes fitted to them.
    """
    wider = np.ones(fitted.covariance.shape[0])
    for j, e in enumerate(estimates):
        wider[j] = e.z_u / np.sqrt(fitted.covariance[j, j])
    kept = [j for j, p in enumerate(problem.unknowns.moved) if p.paths]  # errors of the force are the bench's
    moved = [(p.name, p.paths, p.u, p.factor) for p in problem.unknowns.moved if p.paths]
    made = make_posterior(moved, (fitted.covariance * np.outer(wider, wider))[np.ix_(kept, kept)], sources.seals)
    earlier = posterior_of(problem.action)
    strokes = {} if earlier is None else {f"before: {label}": one for label, one in earlier.strokes.items()}
    by_force = [(t, m) for trials in select_driven_by_force(sources) for t, m in trials if m is not None]
    for observed, m in by_force:
        strokes[observed.label] = describe_stroke(m)
    by_key = [(label, apply_calibration(m, sensors)) for label, m in sources.measured_by_key]
    for label, m in by_key:
        strokes[label] = describe_stroke(m)
    samples = {} if earlier is None else {f"before: {label}": one for label, one in earlier.samples.items()}
    examples = [make_example(m) for _, m in by_force or by_key]  # of one drive
    boxes = fit_black_boxes(examples) if examples else {}
    return replace(
        made,
        before={path: float(problem.action[path]) for path in sorted(made.moved)},
        strokes=strokes,
        samples=samples | {label: list(found) for label, found in sources.samples.items()},
        black_boxes={kind: box.to_plain_values() for kind, box in boxes.items()},
    )


@dataclass(frozen=True)
class Details:
    """The fit behind an `Identification`."""

    problem: Problem  # what was fitted to what
    fitted: Fitted  # where it ended
    profiles: tuple[Profile, ...]  # those that were made
    sources: Sources  # the trials, measured
    left_s: float = math.inf  # processor time that may still be used

    @cached_property
    def explained(self) -> tuple[str, ...]:
        """Sentences on which part of the model explains the difference; computed at first use, in seconds."""
        if not self.fitted.converged:
            return (f"{TITLE} is not asked: {self.fitted.end}.",)
        budget = Budget(self.left_s)
        lines: tuple[str, ...] = (f"{TITLE}: stopped by Ctrl-C.",)
        with budget.interruptible():
            lines = explained_lines(self.problem.action, self.sources)
            lines += () if self.supported is None else self.supported.lines
        return lines

    @cached_property
    def supported(self) -> Supported | None:
        """Estimates that hold in spite of the model's discrepancy; computed at first use."""
        if not self.fitted.converged:
            return None
        return find_supported_estimates(self.problem, self.fitted, lambda line: None, Budget(self.left_s))


FITTED = "fitted trials"


@dataclass(frozen=True, repr=False)
class Identification(Tabular, ArrayRecord):
    """What was found; ``found.to_frame()`` has a row for each asked parameter.

    Attributes
    ----------
    action : with the most probable values of everything that was asked for
    estimates : one for each asked parameter, in the order asked
    correlation : (n, n) of the asked parameters
    undetermined, determined : directions among the asked parameters
    warnings : sentences, the most important first
    starts : twice the negative log likelihood of every fit that was made, the best first
    scatter : name -> standard deviation from trial to trial, relative
    scores : name of a set of trials -> scores of printed and identified values and of the null model
    events : name of a set of trials that were not fitted -> how their events are met, see `held_out`
    provenance : what it was made from
    end : how the fit ended, see `validation.infer.budget`
    posterior : joint uncertainty of everything the fit moved
    sensors : errors of the position sensors, as found; None without such sensors
    details : the fit itself, with the trials
    """

    action: model.Action
    estimates: tuple[Estimate, ...]
    correlation: Array
    undetermined: tuple[Combination, ...]
    determined: tuple[Combination, ...]
    warnings: tuple[str, ...]
    starts: tuple[float, ...]
    scatter: Mapping[str, float]
    scores: Mapping[str, Any]
    events: Mapping[str, Mapping[str, Mapping[str, EventScore]]]
    provenance: Mapping[str, Any]
    posterior: Posterior
    end: End
    sensors: SensorCalibration | None
    details: Details = field(repr=False, compare=False)

    def __repr__(self) -> str:
        lines = [f"{e.name} = {e.value:.4g} ± {e.u:.2g} {e.unit}: {e.verdict}" for e in self.estimates[:MOST_SHOWN]]
        more = len(self.estimates) - len(lines)
        ends = [f"and {more} more"] if more else []
        return "\n  ".join([f"<Identification of {self.action.name}: {self.end}", *lines, *ends]) + ">"

    def columns(self) -> dict[str, Any]:
        """One row for each asked parameter, as of `validation.infer.estimates.Estimate`."""
        return {item.name: [getattr(e, item.name) for e in self.estimates] for item in fields(Estimate)}

    def plot(self, *names: str, ax: Axes | None = None, **style: Any) -> Axes:
        """Draw each value with its 95 % interval, relative to the value before, into ``ax`` or a new figure.

        Parameters
        ----------
        names : of parameters; by default all
        ax : matplotlib axes
        style : what matplotlib's ``errorbar`` takes
        """
        drawn = axes_or_new(ax)
        shown = [e for e in self.estimates if not names or e.name in names]
        for i, e in enumerate(shown):
            size = abs(e.prior) or 1.0  # a value before of 0 has no size of its own
            ends = [[(e.value - e.low) / size], [(e.high - e.value) / size]]
            drawn.errorbar([(e.value - e.prior) / size], [i], xerr=ends, **{"fmt": "o", "color": "black", **style})
        drawn.axvline(0.0, color="#777777", linewidth=0.7)
        drawn.set_yticks(range(len(shown)), [e.name for e in shown])
        drawn.set_xlabel("change from the value before, of that value")
        return drawn

    def save(self, path: str | Path) -> Path:
        """Write the action file (``.toml``), or the table as ``.csv``, ``.h5`` or ``.parquet``; return the path."""
        target = Path(path)
        if target.suffix != ".toml":
            return super().save(target)
        write_text(check_target(target), identified_text(self))
        return target
