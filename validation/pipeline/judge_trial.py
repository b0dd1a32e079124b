"""Each trial of a session judged as soon as it is sealed: measured against predicted, beside what repeats so far.

Conventions: SI and rad; model − trial. No uncertainty is drawn and no verdict given: that is `validation.compare`'s.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

import model
from model.tolerance import DEFAULT_TOLERANCE
from rig.session import Session
from validation.cache.result_store import ResultStore
from validation.conventions import Array
from validation.curves.display_signs import SIGN
from validation.events.session_events import find_session_events
from validation.findings.find_faults import find_faults
from validation.measurement.measure_session import measure_session, open_session
from validation.measurement.trial import U_REST_LEVEL_M, MeasuredTrial
from validation.pipeline.compare_session import load_model
from validation.prediction.model_under_test import ModelUnderTest
from validation.prediction.predict_session import PredictedSession, PredictedTrial, predict_session
from validation.scores.curve_scores import score_curve
from validation.scores.score_session import ScoredSession, trace_session
from validation.scores.traces import SessionTraces, select_scored_angles
from validation.statistics.repeatability import curve_repeatability, interpolate_to_base
from validation.verdict.error_draws import TrialErrors, errors_of_trials, select_usable_errors
from validation.verdict.observed import ObservedDifference, observed_differences
from validation.verdict.quantities import BRANCH, QUANTITIES, branch_of, quantity_limits, relevance_limits

MOST_TRIALS = 12  # of a condition, the last ones: what is said of them takes a tenth of a second each
MOST_POINTS = 300  # of a curve


@dataclass(frozen=True)
class TrialJudgement:
    """One trial, measured against predicted.

    Attributes
    ----------
    number, condition : of the trial
    n_trials : trials that repeatability and findings rest on, this one included
    rmse_rad, repeatability_rad : by channel; the repeatability standard deviation is NaN of one trial
    differences : of the quantities of the verdict, with their scatter
    differing : words for every quantity beyond its limit of relevance, and for what happens in one of the two only
    findings : what is seen in this trial
    curves : by channel time_s, measured_rad, predicted_rad
    """

    number: int
    condition: str
    n_trials: int
    rmse_rad: Mapping[str, float]
    repeatability_rad: Mapping[str, float]
    differences: tuple[ObservedDifference, ...]
    differing: tuple[str, ...]
    findings: tuple[str, ...]
    curves: Mapping[str, Mapping[str, Array]]

    def lines(self) -> list[str]:
        """The judgement in lines of text to print: RMSE of each channel, quantities that differ, and findings."""
        names = self.rmse_rad
        errors = ", ".join(
            f"{name} {np.degrees(self.rmse_rad[name]):.2g}°"
            + (f" (sᵣ {np.degrees(s):.1g}°)" if np.isfinite(s := self.repeatability_rad[name]) else "")
            for name in names
        )
        where = f" of {self.condition}" if self.condition else ""
        out = [f"trial {self.number}{where}: RMSE {errors or 'of no channel'}"]
        if self.differing:
            out.append(f"  differs (± standard deviation so far): {'; '.join(self.differing)}")
        else:
            out.append("  no quantity beyond its limit" if self.differences else "  no quantity can be compared")
        return [*out, *(f"  finding: {text}" for text in self.findings)]

    def content(self) -> dict[str, Any]:
        """Judgement as plain values for JSON, None for NaN; curves in degrees, with the thesis's signs."""
        return {
            "trial": self.number,
            "lines": self.lines(),
            "condition": self.condition,
            "n_trials": self.n_trials,
            "rmse_rad": {name: _round_or_none(x) for name, x in self.rmse_rad.items()},
            "repeatability_rad": {name: _round_or_none(x) for name, x in self.repeatability_rad.items()},
            "differences": {
                d.quantity.name: {"value": d.value, "scatter": _round_or_none(d.scatter), "unit": d.quantity.unit}
                for d in self.differences
            },
            "differing": list(self.differing),
            "findings": list(self.findings),
            "curves": {
                name: {
                    key.replace("_rad", "_deg"): [
                        _round_or_none(x) for x in (values if key == "time_s" else SIGN[name] * np.degrees(values))
                    ]
                    for key, values in curve.items()
                }
                for name, curve in self.curves.items()
            },
        }


def _round_or_none(x: float) -> float | None:
    return round(float(x), 9) if np.isfinite(x) else None


@dataclass
class TrialJudge:
    """Judges the trials of one session one after the other; each is measured and simulated once.

    Parameters
    ----------
    action : model.Action, name or path
    tolerance : requested largest error of any predicted angle, rad

    Examples
    --------
    >>> import rig, validation
    >>> judge = validation.TrialJudge("hirschkorn2004")
    >>> judged = [judge.judge(rig.open_session("sessions/example_forte"), number) for number in (1, 2, 3)]
    >>> judged[-1].n_trials, 0.0 < judged[-1].rmse_rad["hammer"] < 0.01
    (3, True)
    """

    action: model.Action | str | Path
    tolerance: float = DEFAULT_TOLERANCE
    tested: ModelUnderTest = field(init=False, repr=False)
    _known: dict[str, list[tuple[MeasuredTrial, PredictedTrial]]] = field(init=False, repr=False, default_factory=dict)

    def __post_init__(self) -> None:
        self.tested = ModelUnderTest(load_model(self.action), self.tolerance, rivals=(), store=ResultStore())
        model.compile_ahead([model.choice_of(self.tested.action)])  # while the first trial is recorded

    def judge(self, session: Session | str | Path, number: int) -> TrialJudgement:
        """Measure and predict the trial ``number`` of a session and compare it, beside the last trials of its condition
        judged before by this object, which keeps it; no uncertainty is drawn, nothing written. Raises where it cannot
        be used.

        Raises
        ------
        ValidationInputError, TrialError
            The trial cannot be used, or the model does not run under its force.
        """
        tested, opened = self.tested, open_session(session)
        trial = opened.trial(number)
        condition = trial.condition
        measured = measure_session(opened, tested.geometry_at, U_REST_LEVEL_M, only=number)
        predicted = predict_session(measured, tested)
        m = predicted.trials[0]
        known = [pair for pair in self._known.get(condition, []) if pair[0].number != number]
        known = self._known[condition] = [*known, (m, predicted.predictions[number])][-MOST_TRIALS:]
        every = PredictedSession(tuple(one for one, _ in known), {one.number: p for one, p in known}, {})
        events = find_session_events(every, tested)
        traces = trace_session(every, events)
        scored = ScoredSession(traces, pd.DataFrame())
        limits = relevance_limits({})
        errors_found = errors_of_trials(every, traces, events, tested)
        findings = find_faults(every, events, scored, tested, errors_found, limits)
        found = select_usable_errors(errors_found, findings.left_out)
        rows: tuple[ObservedDifference, ...] = ()
        differing: list[str] = []
        if number in found:
            errors = np.array([one.errors for one in found.values()])
            rows = tuple(observed_differences(errors, list(found).index(number)))
            differing = _list_differing(found[number], branch_of(events.model[number]), rows, limits)
        channels = [c for c in m.channels if (number, c) not in findings.left_out]
        return TrialJudgement(
            number=number,
            condition=condition,
            n_trials=len(known),
            rmse_rad={c: _rmse(traces, number, c) for c in channels},
            repeatability_rad={c: _repeatability(traces, c, findings.left_out) for c in channels},
            differences=rows,
            differing=tuple(differing),
            findings=tuple(f.text for f in findings.faults if number in f.numbers),
            curves={c: _curve(traces, number, c) for c in m.channels},
        )


def _list_differing(
    own: TrialErrors, of_model: int, rows: Sequence[ObservedDifference], limits: Mapping[str, float]
) -> list[str]:
    """Texts on events that only the trial or only the model has (``of_model``: its branch), and on quantities of
    ``rows``, model − trial, beyond their ``limits`` of relevance (by name); ``own``: errors and branch of the trial."""
    apart = own.branch ^ (of_model & own.known)
    out = [
        f"{words[not own.branch >> i & 1]} in the trial, {words[not of_model >> i & 1]} in the model"
        for i, words in enumerate(BRANCH.values())
        if apart >> i & 1
    ]
    bound = dict(zip(QUANTITIES, quantity_limits(limits, own.travel, own.values), strict=True))
    for row in rows:
        if abs(row.value) > bound[row.quantity]:
            unit = row.quantity.unit_shown
            out.append(f"{row.quantity.title} {row}{'' if unit == '°' else ' '}{unit}")
    return out


def _difference(traces: SessionTraces, number: int, channel: str) -> tuple[Array, Array, Array]:
    frame = traces.encoder[number]
    frame = frame[traces.window.mask(frame["time_s"].to_numpy())]
    predicted = frame[f"{channel}_predicted_rad"].to_numpy()
    return frame["time_s"].to_numpy(), select_scored_angles(frame, channel), predicted


def _rmse(traces: SessionTraces, number: int, channel: str) -> float:
    return float(score_curve(*_difference(traces, number, channel))["rmse_rad"])


def _repeatability(traces: SessionTraces, channel: str, without: Collection[tuple[int, str]]) -> float:
    frames = {number: frame for number, frame in traces.encoder.items() if (number, channel) not in without}
    if len(frames) < 2:
        return float("nan")
    return curve_repeatability(interpolate_to_base(traces.base_s, frames, f"{channel}_measured_rad")).pooled


def _curve(traces: SessionTraces, number: int, channel: str) -> dict[str, Array]:
    time, measured, predicted = _difference(traces, number, channel)
    every = slice(None, None, max(1, -(-time.size // MOST_POINTS)))
    return {"time_s": time[every], "measured_rad": measured[every], "predicted_rad": predicted[every]}
