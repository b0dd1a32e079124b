"""Kinds of stroke in one session, told apart by their forces before anything is pooled."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from validation.conventions import Array
from validation.findings.finding import BLOW, SessionFinding, register_kinds
from validation.measurement.trial import MeasuredTrial, trials_in_words
from validation.statistics.domain import STEP_S

HELD_S = 0.02  # longer than the spike at the key's bed, which scatters
ONSET = (0.1, 0.5)  # of that force, between which the slope of its onset is taken: choice


def sustained_force_n(m: MeasuredTrial) -> float:
    """Largest force above the preload that is reached for 20 ms in all, N."""
    force = np.sort(m.force.force_n - m.force.preload_n)[::-1]
    step = float(np.median(np.diff(m.force.time_s)))
    return float(force[min(round(HELD_S / step), force.size - 1)])


def onset_u_s(m: MeasuredTrial) -> float:
    """Standard uncertainty of when the force began to act, s: the channel's noise over the slope of the rise."""
    above = m.force.force_n - m.force.preload_n
    held = sustained_force_n(m)
    low, high = (int(np.argmax(above > share * held)) for share in ONSET)
    rise = float(m.force.time_s[high] - m.force.time_s[low])
    return m.force.noise_n * rise / ((ONSET[1] - ONSET[0]) * held) if held > 0 else float("inf")


def impulse_n_s(m: MeasuredTrial) -> float:
    """Impulse above the preload, N s."""
    step = np.gradient(m.force.time_s)
    return float(np.sum(step * np.maximum(m.force.force_n - m.force.preload_n, 0.0)))


APART = 0.22  # of the force's size: a stroke that is a quarter louder
ALIKE = 0.07  # strokes of one plan lie that close together at most
OVER_ALIKE = 3.0  # times the longest join of one kind: choice


def group_strokes(trials: Sequence[MeasuredTrial]) -> tuple[tuple[int, ...], ...]:
    """Trial numbers of each kind of stroke, told apart by their force curves, kinds in the order of their first trials;
    one kind where all are alike.

    Conventions: distance of two strokes is the root mean square difference of their forces, since their onsets and
    averaged over 20 ms, over the root mean square of the larger one, as far as both were recorded. Strokes are joined
    nearest first (single linkage). The kinds are those before the first join over 0.22 that is also three times as long
    as the one before it, or as what strokes of one plan lie apart, if that is more. Source: Gower and Ross (1969),
    Applied Statistics 18, 54.
    """
    numbers = [m.number for m in trials]
    if len(trials) < 2:
        return (tuple(numbers),)
    curves = [_align_force(m) for m in trials]
    joins = sorted((_force_distance(curves[i], curves[j]), i, j) for i, j in combinations(range(len(trials)), 2))
    group = list(range(len(trials)))
    longest = ALIKE
    for distance, i, j in joins:
        if group[i] == group[j]:
            continue
        if distance > max(APART, OVER_ALIKE * longest):
            break
        longest = max(longest, distance)
        group = [group[i] if g == group[j] else g for g in group]
    return tuple(tuple(numbers[k] for k, g in enumerate(group) if g == first) for first in dict.fromkeys(group))


def _align_force(m: MeasuredTrial) -> Array:
    """Force above the preload since its onset, averaged over `HELD_S`."""
    at = np.arange(-HELD_S, float(m.force.time_s[-1]) - m.quiet.onset_s, STEP_S)
    weights = np.full(round(HELD_S / STEP_S), STEP_S / HELD_S)
    return np.convolve(np.interp(at + m.quiet.onset_s, m.force.time_s, m.force.force_n - m.force.preload_n), weights)


def _force_distance(one: Array, other: Array) -> float:
    """Root mean square difference over the root mean square of the larger one, as far as both were recorded."""
    n = max(min(one.size, other.size) - round(HELD_S / STEP_S), 1)
    size = max(float(np.sqrt(np.mean(curve[:n] ** 2))) for curve in (one, other))
    return float(np.sqrt(np.mean((one[:n] - other[:n]) ** 2))) / max(size, 1e-12)


@register_kinds({"mixed strokes": "Validate the kinds of stroke apart (conditions of the plan, or pianorig annotate)."})
def find_mixed_strokes(trials: Sequence[MeasuredTrial], kinds: Sequence[Sequence[int]]) -> list[SessionFinding]:
    """One finding where several ``kinds`` (lists of trial numbers, as of `group_strokes`) have more than one trial, or
    where each of several has one only; else an empty list. The value is the number of such kinds."""
    named = [kind for kind in kinds if len(kind) > 1] or list(kinds)
    if len(named) < 2:
        return []
    held = {m.number: sustained_force_n(m) for m in trials}
    impulse = {m.number: impulse_n_s(m) for m in trials}
    parts = [
        f"{trials_in_words(kind)} ({np.median([held[n] for n in kind]):.3g} N held for 20 ms, "
        f"{np.median([impulse[n] for n in kind]):.3g} N s)"
        for kind in named
    ]
    text = (
        f"{len(named)} kinds of stroke: {', '.join(parts)}; repeatability and odd trials are those within each kind, "
        "and there is no band of their mean"
    )
    return [SessionFinding("mixed strokes", float("nan"), "force", float(len(named)), 1.0, text)]


@register_kinds(
    {"stroke of its own": "Validate the stroke unlike the others apart, or reject it (pianorig annotate)."}, spoils=BLOW
)
def find_single_strokes(trials: Sequence[MeasuredTrial], kinds: Sequence[Sequence[int]]) -> list[SessionFinding]:
    """One finding for each trial that is alone in its kind, where another kind has several; ``kinds``: lists of trial
    numbers, as of `group_strokes`. The value is its force held for 20 ms, N."""
    if not any(len(kind) > 1 for kind in kinds):
        return []
    held = {m.number: sustained_force_n(m) for m in trials}
    impulse = {m.number: impulse_n_s(m) for m in trials}
    out = []
    for number in (kind[0] for kind in kinds if len(kind) == 1):
        usual_n, usual_n_s = (float(np.median([v for n, v in of.items() if n != number])) for of in (held, impulse))
        text = (
            f"trial {number}: its force is unlike that of every other trial: {held[number]:.3g} N held for 20 ms "
            f"(others {usual_n:.3g} N), {impulse[number]:.3g} N s (others {usual_n_s:.3g} N s); it is pooled with none"
        )
        out.append(SessionFinding("stroke of its own", number, "", held[number], usual_n, text))
    return out
