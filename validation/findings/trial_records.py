"""Records that are copies of one another, end early or have another rate than most; trials stay in, never removed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations

import numpy as np

from validation.findings.finding import BLOW, OF_TRIALS, SessionFinding, register_kinds
from validation.measurement.measure_session import NOT_PREDICTED, OTHER_CONDITION, REJECTED
from validation.measurement.trial import MeasuredTrial

RATE_RELATIVE = 1e-4  # twice the worst clock of a card: another setting, not another clock
SHORT_S, SHORT_SHARE = 0.02, 0.1  # by which a record ends early: choice, seconds and of the shortest usual one


@register_kinds({"sample rate": "Record all trials at one rate."}, among=OF_TRIALS)
def find_unusual_rates(measured: Sequence[MeasuredTrial]) -> list[SessionFinding]:
    """One finding for each trial whose mean sample rate, Hz, the value, differs by more than 1e-4 from the median rate
    of all."""
    rate = {m.number: (m.time_s.size - 1) / float(m.time_s[-1] - m.time_s[0]) for m in measured}
    usual = float(np.median(list(rate.values())))
    return [
        SessionFinding(
            "sample rate",
            number,
            "",
            value,
            usual,
            f"trial {number}: sampled at {value:.6g} Hz, most trials at {usual:.6g} Hz; curves are put on one time "
            f"base by straight lines (limit {RATE_RELATIVE:g} of the rate)",
        )
        for number, value in rate.items()
        if abs(value / usual - 1) > RATE_RELATIVE
    ]


@register_kinds({"short record": "Annotate the trial that ends early, or record it again: no score looks further."})
def find_short_records(measured: Sequence[MeasuredTrial]) -> list[SessionFinding]:
    """One finding for each trial whose record ends more than 20 ms, and more than a tenth, before the median end of
    all; the value is its end, s. Scores look no further than the shortest record."""
    end = {m.number: float(m.time_s[-1]) for m in measured}
    usual = float(np.median(list(end.values())))
    return [
        SessionFinding(
            "short record",
            number,
            "",
            value,
            usual,
            f"trial {number}: its record ends at {value:.3f} s, those of like strokes at {usual:.3f} s (median; limit "
            f"{max(SHORT_S, SHORT_SHARE * usual):.3f} s less); no score looks further than the shortest record",
        )
        for number, value in end.items()
        if value < usual - max(SHORT_S, SHORT_SHARE * usual)
    ]


@register_kinds({"not used": ""}, spoils=BLOW)
def find_unused_trials(refused: Mapping[int, str]) -> list[SessionFinding]:
    """Trials that cannot be used, of the reason for each that is not (`MeasuredSession.refused`)."""
    return [
        SessionFinding("not used", number, "", float("nan"), float("nan"), f"trial {number} is not used: {reason}")
        for number, reason in refused.items()
        if not reason.startswith((REJECTED, OTHER_CONDITION, NOT_PREDICTED))
    ]


FEWEST_MOVED = 50  # samples that differ from the one before: two records of rest may well agree


@register_kinds({"duplicated trial": "Reject the copy (pianorig annotate)."}, spoils=BLOW, among=OF_TRIALS)
def find_duplicates(trials: Sequence[MeasuredTrial]) -> list[SessionFinding]:
    """One finding for each trial whose encoder counts or raw force readings equal an earlier trial's at every sample;
    the value is that trial's number. Records with fewer than 50 changing samples do not count."""
    out = []
    sums = {m.number: (float(_read_counts(m).sum()), float(m.raw_force_n.sum())) for m in trials}
    for first, second in combinations(trials, 2):
        if not any(a == b for a, b in zip(sums[first.number], sums[second.number], strict=True)):
            continue  # of many trials reading all pairs sample by sample takes seconds
        same = [
            words
            for words, a, b in (
                ("counts", _read_counts(first), _read_counts(second)),
                ("force readings", first.raw_force_n, second.raw_force_n),
            )
            if a.shape == b.shape and np.array_equal(a, b) and np.count_nonzero(np.diff(a, axis=0)) >= FEWEST_MOVED
        ]
        if not same:
            continue
        text = (
            f"trial {second.number}: the same {' and '.join(same)} as in trial {first.number} at every sample: it is a "
            "copy"
        )
        out.append(SessionFinding("duplicated trial", second.number, "", float(first.number), 0.0, text))
    return out


def _read_counts(m: MeasuredTrial) -> np.ndarray:
    return np.rint((m.change_rad - m.change_rad[0]) / m.resolution_rad)
