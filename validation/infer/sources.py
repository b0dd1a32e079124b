"""Trials of the sessions that are fitted, and of those that are only predicted.

One kind of stroke a session (or one condition of its plan). A force drives the model where one was recorded, else the
key's measured motion; a trial with neither is named and left out. Sessions of different actions are refused.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import TypedDict

import model
from rig.session import Session
from validation.errors import ValidationInputError
from validation.infer.observations import (
    PHASES,
    ObservedTrial,
    observe,
    observe_driven,
    observe_positions,
    share_key_errors,
)
from validation.infer.response import TOLERANCE
from validation.measurement.measure_session import (
    OTHER_CONDITION,
    MeasuredSession,
    conditions_of,
    measure_session,
    open_session,
)
from validation.measurement.sample_fingerprints import are_same_stroke
from validation.measurement.trial import U_REST_LEVEL_M, MeasuredTrial, trials_in_words
from validation.options import utc_now
from validation.prediction.model_under_test import ModelUnderTest
from validation.prediction.posterior import posterior_of


class IdentifyKeywords(TypedDict, total=False):
    """Keywords of `validation.identify`, see `IdentifyOptions`."""

    fixed: tuple[str, ...]
    priors: Mapping[str, float]
    hold_out: tuple[str | Path, ...]
    hold_out_trials: tuple[int, ...]
    starts: int
    profiles: tuple[str, ...] | None
    phases: int
    tolerance: float
    condition: str | None
    motion_driven: bool
    film: bool
    budget_s: float | None
    executor: Executor | None
    progress: Callable[[str], None] | None
    now: Callable[[], datetime]


@dataclass(frozen=True)
class IdentifyOptions:
    """How to identify."""

    fixed: tuple[str, ...] = ()  # names held at the action's values, see `validation.infer.unknowns`
    # name -> standard uncertainty before the strokes; relative for laws of friction, felt and springs, SI else
    priors: Mapping[str, float] = field(default_factory=dict)
    hold_out: tuple[str | Path, ...] = ()  # sessions that are not fitted and only predicted
    hold_out_trials: tuple[int, ...] = ()  # numbers of trials that are not fitted, in every session
    starts: int = 1  # how many points the fit starts from; the first is the action's own values
    profiles: tuple[str, ...] | None = None  # names to make a profile of; by default all that were asked for
    phases: int = PHASES  # how many times of each trial are compared
    tolerance: float = TOLERANCE  # largest error of any angle of a run, rad
    condition: str | None = None  # condition of the trial plan to use
    # the key's measured motion drives the model in all trials, not only in those without a force
    motion_driven: bool = False
    film: bool = False  # compare jack and repetition lever as tracked on films, too
    budget_s: float | None = None  # processor time, s; by default from the numbers of trials and parameters
    executor: Executor | None = None  # where the model runs; by default threads of this process
    progress: Callable[[str], None] | None = None  # called with a line of text
    now: Callable[[], datetime] = utc_now  # the clock of the date in the provenance

    def say(self, text: str) -> None:
        """Report progress."""
        if self.progress is not None:
            self.progress(text)


UNKNOWN = "unknown"


@dataclass(frozen=True)
class Sources:
    """What an identification is made from."""

    fitted: tuple[ObservedTrial, ...]  # trials to fit
    held: dict[str, tuple[ObservedTrial, ...]]  # name -> trials that are only predicted
    seals: dict[str, str]  # label -> SHA-256 of every fitted trial
    samples: dict[str, tuple[str, ...]]  # label -> fingerprints of its samples
    refused: tuple[str, ...]  # lines on trials that could not be used
    sessions: tuple[Session, ...] = ()  # those opened, to fit first
    measured: tuple[MeasuredTrial, ...] = ()  # the trials to fit that a force drives, as measured
    # name -> trials that are only predicted and that a force drives, as measured
    measured_held: Mapping[str, tuple[MeasuredTrial, ...]] = field(default_factory=dict)
    notes: tuple[str, ...] = ()  # lines on what was recorded and is not used
    measured_by_key: tuple[tuple[str, MeasuredTrial], ...] = ()  # label and trial of those that the key drives


def collect(sessions: Sequence[Session | str | Path], action: model.Action, options: IdentifyOptions) -> Sources:
    """Trials of ``sessions`` to fit and of those held out by ``options``, read, measured and thinned, with a line on
    each refused one; input error where they cannot be fitted together, or the action was fitted to one before.

    Raises
    ------
    ValidationInputError
        No session, sessions of different actions, one given twice, one without a usable trial, a trial to hold out that
        is not there, or one that the action's values were fitted to before.
    """
    if not sessions:
        raise ValidationInputError("identify: no session given; name at least one session folder")
    opened = [open_session(s) for s in [*sessions, *options.hold_out]]
    _refuse_twice(opened)
    _refuse_other_actions(opened)
    tested = ModelUnderTest(action, options.tolerance)
    found, parts, names = [], [], []
    for s, called in zip(opened, _names(opened), strict=True):
        conditions = _conditions(s, options)
        for condition in conditions:
            found.append(
                measure_session(
                    s, tested.geometry_at, U_REST_LEVEL_M, condition, options.motion_driven, tested.calibration
                )
            )
            parts.append(s)
            names.append(called if len(conditions) == 1 else f"{called}, {condition}")
    n_to_fit = sum(any(s is one for one in opened[: len(sessions)]) for s in parts)
    _refuse_absent(options.hold_out_trials, found[:n_to_fit])
    fitted: list[ObservedTrial] = []
    seals: dict[str, str] = {}
    samples: dict[str, tuple[str, ...]] = {}
    held: dict[str, tuple[ObservedTrial, ...]] = {}
    refused: list[str] = []
    to_fit: list[MeasuredTrial] = []
    by_key: list[tuple[str, MeasuredTrial]] = []
    as_measured: dict[str, tuple[MeasuredTrial, ...]] = {}
    strokes: list[tuple[str, MeasuredTrial]] = []
    for k, (name, measured) in enumerate(zip(names, found, strict=True)):
        refused += [
            f"{name}, trial {number}: {reason}"
            for number, reason in measured.refused.items()
            if options.condition is not None or not reason.startswith(OTHER_CONDITION)
        ]
        kept = [m for m in measured.trials if k < n_to_fit and m.number not in options.hold_out_trials]
        out = [m for m in measured.trials if k >= n_to_fit or m.number in options.hold_out_trials]
        if k < n_to_fit and not kept and not (out and parts.count(measured.session) > 1):
            raise ValidationInputError(_no_trials_message(measured, name, len(out)))
        if kept:
            observed, by_force = _observe_session(name, k, kept, options)
            fitted += observed
            seals |= {t.label: m.seal for t, m in zip(observed, kept, strict=True)}
            samples |= {t.label: m.samples for t, m in zip(observed, kept, strict=True)}
            strokes += [(f"{name}, trial {m.number}", m) for m in kept]
            to_fit += kept if by_force else []
            by_key += [] if by_force else [(t.label, m) for t, m in zip(observed, kept, strict=True)]
        if out:
            label = f"{name}, held out" if kept else name
            seen, by_force = _observe_session(name, 0, out, options)
            held[label] = tuple(seen)
            strokes += [(f"{label}, trial {m.number}", m) for m in out]
            if by_force:
                as_measured[label] = tuple(out)
    _refuse_same_stroke(strokes)
    _refuse_used_before(action, seals, samples)
    fitted = share_key_errors(fitted)
    notes = _unused_words([m for one in found for m in one.trials], options)
    return Sources(
        tuple(fitted), held, seals, samples, tuple(refused), tuple(opened), tuple(to_fit), as_measured, notes,
        tuple(by_key),
    )  # fmt: skip


def _conditions(session: Session, options: IdentifyOptions) -> Sequence[str | None]:
    """Conditions of a session, each treated as a session: all of an imported one, else the requested one."""
    several = not session.info.plan.conditions and options.condition is None
    found = conditions_of(session) if several else []
    return found if len(found) > 1 else [options.condition]


def _observe_session(
    name: str, session: int, trials: Sequence[MeasuredTrial], options: IdentifyOptions
) -> tuple[list[ObservedTrial], bool]:
    """Trials of one session as they are compared, and whether a force drives them: all of them, or none."""
    by_force = not any(m.driven_by_key for m in trials)
    of_positions = all(m.sensors is not None for m in trials)
    see = observe if by_force else observe_positions if of_positions else observe_driven
    return see(name, session, trials, options.phases, options.film), by_force


def _unused_words(trials: Sequence[MeasuredTrial], options: IdentifyOptions) -> tuple[str, ...]:
    """Lines on films that were recorded and are not used or asked for and missing, and on sessions driven by their key
    because some trials have no force."""
    filmed, out = sum(m.film is not None for m in trials), []
    if filmed and not options.film:
        out.append(f"{filmed} trials have tracked films, which are not used; `film` uses jack and repetition lever")
    if options.film and not filmed:
        out.append("`film`: no trial has a tracked film; track them with pianorig track")
    without = sum(not m.has_force for m in trials)
    if without and without < len(trials) and not options.motion_driven:
        out.append(f"{without} trials have no force and are driven by their key's motion, with all of their session")
    return tuple(out)


def _names(sessions: Sequence[Session]) -> list[str]:
    """A name for each session, by its folder where two would have the same: hashes are kept by it."""
    names = [s.info.name or s.path.name for s in sessions]
    for place in (lambda s: s.path.name, lambda s: str(s.path.resolve())):
        names = [
            f"{s.info.name or s.path.name} ({place(s)})" if names.count(name) > 1 else name
            for name, s in zip(names, sessions, strict=True)
        ]
    return names


def _no_trials_message(measured: MeasuredSession, name: str, held: int) -> str:
    """Message that the session ``name`` has no trial to fit, with the reasons; ``held``: how many of its usable trials
    are held out."""
    if held:
        return (
            f"{name}: no usable trial to fit ({held} held out by `hold_out_trials`); leave at least one of them to fit"
        )
    numbers: dict[str, list[int]] = {}
    for number, why in measured.refused.items():
        numbers.setdefault(why, []).append(number)
    alike = [f"{trials_in_words(of)}: {why}" for why, of in list(numbers.items())[:3]]
    reasons = "; ".join(alike) or "it has no trials"
    return f"{name}: no usable trial to fit ({reasons}); a fit needs measured key, whippen and hammer angles"


def _refuse_absent(wanted: Sequence[int], of_sessions: Sequence[MeasuredSession]) -> None:
    """Raise an input error where no session has a trial of a ``wanted`` number, to be held out: it would be fitted
    under another number without a word."""
    there = {n for one in of_sessions for n in (*one.refused, *(m.number for m in one.trials))}
    absent = [n for n in wanted if n not in there]
    if absent:
        raise ValidationInputError(
            f"`hold_out_trials` {absent[0]}: no session to fit has a trial of this number; found "
            f"{', '.join(map(str, sorted(there))) or 'none'}"
        )


def _refuse_twice(opened: Sequence[Session]) -> None:
    places = [s.path.resolve() for s in opened]
    for place in places:
        if places.count(place) > 1:
            raise ValidationInputError(
                f"{place}: session given twice; name each session once, to fit or with `hold_out`"
            )


def _refuse_same_stroke(strokes: Sequence[tuple[str, MeasuredTrial]]) -> None:
    """Raise an input error where one stroke is given twice, as in a copy of its session: it would count twice, or
    predict itself."""
    for k, (label, m) in enumerate(strokes):
        for first, other in strokes[:k]:
            if m.seal == other.seal or are_same_stroke(m.samples, other.samples):
                raise ValidationInputError(
                    f"{label}: is the same stroke as {first} (by hash); give each stroke once, to fit or to hold out"
                )


def _refuse_used_before(action: model.Action, seals: Mapping[str, str], samples: Mapping[str, tuple[str, ...]]) -> None:
    """Raise an input error where the action's values were fitted to one of these trials before, as data would count
    twice; ``seals``, ``samples``: label -> SHA-256 and sample fingerprints of each trial to fit."""
    before = posterior_of(action)
    used = [label for label in seals if before is not None and before.was_fitted_to(seals[label], samples[label])]
    if used:
        raise ValidationInputError(
            f"{action.origin}: its values were fitted to {used[0]} already"
            f"{f' and to {len(used) - 1} more of these trials' if used[1:] else ''}, which would count twice; start "
            "from the action they were identified from, or give other trials"
        )


def _refuse_other_actions(opened: Sequence[Session]) -> None:
    """Raise an input error where sessions state different actions, by name or key; ``unknown`` agrees with any."""
    for what in ("name", "key"):
        known = {getattr(s.info.action, what): s.path.name for s in opened}
        known.pop(UNKNOWN, None)
        if len(known) > 1:
            listed = ", ".join(f"{value!r} in {folder}" for value, folder in known.items())
            raise ValidationInputError(
                f"identify: sessions of different actions ({what}: {listed}); allowed one; identify each by itself"
            )
