"""Spikes of the force that key and whippen do not answer.

A force of a stroke is full of true spikes, where arm and key, and key and bed, part and meet. So a spike is judged by a
second reading of the same event: the model is run on with the force and with the spike taken out, and what key and
whippen read after it is compared with both. Where the model misses the motion, as of a key that rings on its bed, other
trials of the same stroke tell what it misses and what the force is like there.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from model.errors import ModelError
from validation.conventions import BODIES, Array, rms
from validation.events.crossings import find_runs
from validation.events.encoder_readings import NOISE_SIGMAS, measure_step_excess
from validation.findings.finding import PREDICTION, SessionFinding, register_kinds
from validation.measurement.trial import MeasuredTrial
from validation.prediction.model_under_test import ModelUnderTest
from validation.prediction.predict_session import PredictedAngles

MEDIAN_S = 6e-3  # window of the running median: twice the longest spike
LONGEST_S, LONGEST_UNLIKE_S = MEDIAN_S / 2, 0.06
"""Of a spike: half of the running median's window, which does not follow anything shorter; of one that no other trial
of the stroke has, far less than a stroke."""
LEAST_N = 0.3
"""A spike leaves the running median by so much, and by `NOISE_SIGMAS`: choice, smaller ones hardly turn a key."""
AFTER_S = 8e-3
"""Over which the answer is compared; a key that is pushed freely turns by most of it in that time."""
BEFORE_S = AFTER_S / 2
"""The comparison begins that long before a spike: a straight line takes up by what the model drifts."""
MISSED_S = BEFORE_S + AFTER_S
"""Time before a spike in which is seen by how much the model misses key and whippen anyway."""
ROUNDING = 0.5
"""Counts, the least that the model can be said to miss."""
FEWEST_MISSES, FEWEST_SCATTERS = 5.0, 3.0
"""Size of a lacking answer over what the model misses without it: sound trials reach 2.3, planted spikes 7 to 50; and
over what other trials scatter by, where also the force must be unlike theirs by so many times of what they scatter."""
FEWEST_LIKE = 3
"""Other trials of the same stroke that tell what is usual: their median stands against one that is wrong."""
MOST_LIKE = 15
"""Of them, the nearest by number: their median has a standard uncertainty of a third of the trials' scatter."""
LACKING = (0.6, 1.6)
"""Share of the answer that is lacking: 1 but for the estimated size of the spike; of a true one it is 0."""
MOST_RUN = 4
"""Spikes of a trial for which the model is run: those whose answer could lack most, and as many that stand out most."""
FEWEST = 6
"""Samples of the comparison."""
BOTH = ("key", "whippen")


@dataclass(frozen=True, eq=False)
class Spike:
    """Samples of the force from ``first`` on that a spike changes, and by how much, N, (k,)."""

    first: int
    change_n: Array

    @property
    def last(self) -> int:
        """Last sample that it changes."""
        return self.first + self.change_n.size - 1

    @property
    def size_n(self) -> float:
        """Its largest value with the sign of it, N."""
        return float(self.change_n[np.abs(self.change_n).argmax()])


def find_candidate_spikes(m: MeasuredTrial) -> list[Spike]:
    """Spikes of the corrected force: stretches of at most 3 ms that leave the running median, or that two opposite
    jumps enclose, by more than 0.3 N and eight times the noise; nothing is said of whether they are true.

    A jump is a step outside of the two steps before and the two after it, as of an encoder. What a spike changes is
    taken against the median, and between two jumps against the straight line over them.
    """
    force, step_s = m.force.force_n, _step_s(m)
    most = max(round(LONGEST_S / step_s), 1)
    excess = np.asarray(force - median_filter(force, 2 * max(round(0.5 * MEDIAN_S / step_s), 1) + 1, mode="nearest"))
    least = max(NOISE_SIGMAS * m.force.noise_n, LEAST_N)
    found = _find_stretches(excess, least, most)
    jump, _ = measure_step_excess(force, m.force.time_s, 0.0, m.quiet.stop)
    at = np.flatnonzero(np.abs(jump) > least)
    for before, after in zip(at, at[1:], strict=False):
        if jump[before] * jump[after] < 0.0 and after - before <= most:
            part = slice(int(before) + 1, int(after) + 1)
            line = np.linspace(force[before], force[after + 1], int(after - before) + 2)[1:-1]
            found.append(Spike(int(before) + 1, force[part] - line))
    return found


def _find_stretches(excess: Array, least: Array | float, max_samples: int) -> list[Spike]:
    """Runs of at most ``max_samples`` samples in which ``excess`` (N), of either sign, exceeds ``least`` (N)."""
    found = []
    for sign in (1.0, -1.0):
        pairs = find_runs(sign * excess > least).tolist()
        found += [Spike(first, excess[first:end]) for first, end in pairs if end - first <= max_samples]
    return found


@dataclass(frozen=True, eq=False)
class LikeTrials:
    """Other trials of a stroke on the times of one, counted from when the key reaches its bed.

    ``force_n`` (k, n) on the times of the force, ``off`` (k, m, 2) counts by which key and whippen miss the model.
    """

    force_n: Array
    off: Array


def subtract_model(m: MeasuredTrial, p: PredictedAngles) -> Array:
    """Key and whippen less the model's, counts, (n, 2)."""
    return np.column_stack([(m.change_rad[:, i] - p.change_rad(name)) / m.resolution_rad[i]
                            for i, name in enumerate(BOTH)])  # fmt: skip


def align_like_trials(
    m: MeasuredTrial, others: Sequence[tuple[MeasuredTrial, PredictedAngles]], bottom_s: Mapping[int, float]
) -> LikeTrials | None:
    """Up to 15 of ``others`` (trial and prediction; ``m`` itself is skipped), nearest by number, shifted in time so
    that all keys reach their beds at once; ``bottom_s``: that time by trial number. None with fewer than 3, or where
    this key reaches no bed."""
    there = [one for one in others if one[0].number != m.number and np.isfinite(bottom_s[one[0].number])]
    if len(there) < FEWEST_LIKE or not np.isfinite(bottom_s[m.number]):
        return None
    there = sorted(there, key=lambda one: abs(one[0].number - m.number))[:MOST_LIKE]
    force, off = [], []
    for other, p in there:
        later = bottom_s[other.number] - bottom_s[m.number]
        force.append(np.interp(m.force.time_s + later, other.force.time_s, other.force.force_n))
        columns = subtract_model(other, p).T
        off.append([np.interp(m.time_s + later, other.time_s, c, left=np.nan, right=np.nan) for c in columns])
    return LikeTrials(np.array(force), np.swapaxes(np.array(off), 1, 2))


@dataclass(frozen=True, eq=False)
class _Suspect:
    """A spike, the samples it is judged by, and there the difference from the model and what it is without a spike."""

    spike: Spike
    part: NDArray[np.intp]
    off: Array
    missed: float
    limit: float
    by: str  # what ``missed`` is, in words


def _list_suspects(m: MeasuredTrial, miss_counts: Array, like: LikeTrials | None) -> Iterator[_Suspect]:
    """Yield force spikes that may be faulty readings: by the record alone, then compared with trials ``like`` it;
    ``miss_counts`` (n, 2): key and whippen less the model, counts."""
    for spike in find_candidate_spikes(m):
        before = _select_window(m, spike, -MISSED_S, 0.0)
        missed = rms(_subtract_line(m.time_s[before], miss_counts[before])) if before.size > 2 else 0.0
        part = _select_window(m, spike, -BEFORE_S, AFTER_S)
        yield _Suspect(spike, part, miss_counts[part], max(missed, ROUNDING), FEWEST_MISSES, "else miss the model by")
    if like is None:
        return
    usual_n, usual = np.median(like.force_n, axis=0), np.median(like.off, axis=0)
    scatter_n = np.abs(like.force_n - usual_n).max(axis=0)
    least = np.maximum(FEWEST_SCATTERS * scatter_n, max(NOISE_SIGMAS * m.force.noise_n, LEAST_N))
    for spike in _find_stretches(m.force.force_n - usual_n, least, round(LONGEST_UNLIKE_S / _step_s(m))):
        part = _select_window(m, spike, -BEFORE_S, AFTER_S)
        if part.size >= FEWEST:
            apart = np.swapaxes((like.off - usual)[:, part], 0, 1)
            scatter = rms(_subtract_line(m.time_s[part], apart.reshape(part.size, -1)))
            missed = max(scatter * float(np.sqrt(len(like.off) / (len(like.off) - 1))), ROUNDING)
            yield _Suspect(
                spike, part, (miss_counts - usual)[part], missed, FEWEST_SCATTERS, "else differ from other trials by"
            )


@register_kinds(
    {"unanswered force spike": "Check cable and amplifier of the load cell, and record the trial again."},
    spoils=PREDICTION,
)
def find_unanswered_spikes(
    tested: ModelUnderTest, m: MeasuredTrial, p: PredictedAngles, until_s: float, like: LikeTrials | None = None
) -> list[SessionFinding]:
    """One finding of the force spike before ``until_s``, s, that key and whippen most clearly do not answer, though the
    model does; empty if none. The value is its size, N. ``like``: trials of the same stroke. Simulates, unless stored.

    Conventions: counts of key and whippen, from 4 ms before a spike to 8 ms after it, about a straight line. The answer
    is what the model's motion with the spike and without it differ by; its share that is lacking is that of the
    difference from the model, by least squares. Named where all of the answer lacks and its root mean square is five
    times what is left, and five times what the model missed in the 12 ms before; or three times what is left of the
    difference from other trials of the stroke and what these scatter by, where the force is unlike theirs. Silent about
    smaller answers, and after the release.
    """
    key_per_impulse = 0.5 * AFTER_S * tested.action["drive.point.x"] / tested.action["key.inertia"]
    predicted = np.column_stack([p.change_rad(name) for name in BOTH]) / m.resolution_rad[: len(BOTH)]
    asked, step_s = [], _step_s(m)
    for one in _list_suspects(m, subtract_model(m, p), like):
        if one.part.size < FEWEST or m.time_s[one.part[-1]] > until_s or not np.isfinite(one.off).all():
            continue
        answer = key_per_impulse * step_s * abs(float(one.spike.change_n.sum())) / float(m.resolution_rad[0])
        size = min(rms(_subtract_line(m.time_s[one.part], one.off)), LACKING[1] * answer)
        if size >= one.limit * one.missed:
            asked.append((answer / one.missed, _measure_isolation(m.force.force_n, one.spike), one))
    by_answer = sorted(asked, key=lambda row: row[0], reverse=True)[:MOST_RUN]
    by_isolation = sorted(asked, key=lambda row: row[1], reverse=True)[:MOST_RUN]
    found = []
    for *_, one in {id(row[2]): row for row in (*by_answer, *by_isolation)}.values():
        without = _simulate_without_spike(tested, m, one.spike, one.part)
        if without is None:
            continue
        answers, lacks = (_subtract_line(m.time_s[one.part], x) for x in (predicted[one.part] - without, -one.off))
        share = float((lacks * answers).sum() / max((answers**2).sum(), 1e-12))
        size, missed = share * rms(answers), max(one.missed, rms(lacks - share * answers))
        if LACKING[0] <= share <= LACKING[1] and size >= one.limit * missed:
            found.append((size / missed, size, missed, one))
    if not found:
        return []
    _, size, missed, one = max(found, key=lambda row: row[0])
    start_s, lasts_ms = float(m.time_s[one.spike.first]), 1e3 * _step_s(m) * one.spike.change_n.size
    text = (
        f"trial {m.number}: force: key and whippen do not answer a spike that lasts {lasts_ms:.1f} ms and leaves the "
        f"readings beside it by {one.spike.size_n:+.2g} N, at {start_s:.4f} s: until {1e3 * AFTER_S:g} ms after it "
        f"they lack the {size:.1f} counts (root mean square) by which the model moves for it, and {one.by} "
        f"{missed:.1f} (limit {one.limit:g} times that)"
    )
    return [SessionFinding("unanswered force spike", m.number, "force", one.spike.size_n, one.limit, text)]


def _step_s(m: MeasuredTrial) -> float:
    return float(np.median(np.diff(m.force.time_s)))


def _select_window(m: MeasuredTrial, spike: Spike, after_s: float, until_s: float) -> NDArray[np.intp]:
    """Indices of the encoder samples from ``after_s`` after a spike's begin until ``until_s`` after its end, or after
    its begin where ``until_s`` is not positive."""
    time = m.force.time_s
    last = spike.last if until_s > 0.0 else spike.first
    ends = [max(time[spike.first] + after_s, time[0]), min(time[last] + until_s, time[-1])]
    return np.arange(*np.searchsorted(m.time_s, ends))


def _measure_isolation(force_n: Array, spike: Spike) -> float:
    """Size of a spike over the root mean square of the force's steps before and after it."""
    steps, reach = np.diff(force_n), 4 * spike.change_n.size
    beside = [steps[max(spike.first - 1 - reach, 0) : spike.first - 1], steps[spike.last + 1 : spike.last + 1 + reach]]
    return abs(spike.size_n) / max(float(np.sqrt(np.mean(np.concatenate(beside) ** 2))), 1e-12)


def _simulate_without_spike(
    tested: ModelUnderTest, m: MeasuredTrial, spike: Spike, part: NDArray[np.intp]
) -> Array | None:
    """Key and whippen, (n, 2), in encoder counts since rest, at the encoder samples ``part``, that the model predicts
    with the spike taken out of the force; None where the model cannot run. The result is kept in the model's store."""
    until = int(np.searchsorted(m.force.time_s, m.time_s[part[-1]])) + 2
    time_s, force_n = m.force.time_s[:until], m.force.force_n[:until].copy()
    force_n[spike.first : spike.last + 1] -= spike.change_n
    rest = tested.load(m.force.preload_n).rest
    columns = [BODIES.index(name) for name in BOTH]

    def run() -> list[list[float]] | None:
        try:
            made = tested.simulate(
                tested.action, time_s, force_n, tolerance=tested.tolerance, output_time_s=m.time_s[part], initial=rest
            )
        except ModelError:
            return None
        change = np.asarray(made.angle_rad, dtype=float)[:, columns] - np.asarray(rest.angle_rad, dtype=float)[columns]
        return (change / m.resolution_rad[: len(BOTH)]).tolist()

    inputs = (tested.identity, time_s, force_n, m.force.preload_n, m.time_s[part], m.resolution_rad)
    stored = tested.store.value("force spike", inputs, run)
    return None if stored is None else np.asarray(stored)


def _subtract_line(time_s: Array, values: Array) -> Array:
    """Values (n, k) less the straight line through each column."""
    along = time_s - time_s.mean()
    left = values - values.mean(axis=0)
    return np.asarray(left - np.outer(along, along @ left / (along @ along)))
