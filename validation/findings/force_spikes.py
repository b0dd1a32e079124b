"""Short spikes of the force that key and whippen do not answer.

A force of a stroke is full of true spikes, where arm and key, and key and bed, part and meet. So a spike is judged by a
second reading of the same event: the model is run on with the force and with the spike taken out, and what key and
whippen read after it is compared with both.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from model.errors import ModelError
from validation.conventions import BODIES, Array, rms
from validation.events.encoder_readings import step_excess
from validation.findings.finding import PREDICTION, SessionFinding, finds
from validation.measurement.trial import MeasuredTrial
from validation.prediction.model_under_test import ModelUnderTest
from validation.prediction.predict_session import PredictedAngles

MEDIAN_S = 6e-3
LONGEST_S = 3e-3
"""Of a spike: half of the running median's window, which does not follow anything shorter."""
SIGMAS, LEAST_N = 8.0, 0.3
"""A spike leaves the running median by so many standard deviations of the channel's noise, and by so much."""
AFTER_S = 8e-3
"""Over which the answer is compared; a key that is pushed freely turns by most of it in that time."""
BEFORE_S = 4e-3
"""The comparison begins that long before a spike: a straight line takes up by what the model drifts."""
MISSED_S = BEFORE_S + AFTER_S
"""Time before a spike in which is seen by how much the model misses key and whippen anyway."""
ROUNDING = 0.5
"""Counts, the least that the model can be said to miss."""
FEWEST_MISSES = 5.0
"""Size of a lacking answer over what the model misses without it: sound trials reach 2.3, planted spikes 7 to 50."""
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


def candidate_spikes(m: MeasuredTrial) -> list[Spike]:
    """Stretches, no longer than `LONGEST_S`, that leave the running median, or that two opposite jumps enclose.

    A jump is a step outside of the two steps before and the two after it, as of an encoder. What a spike changes is
    taken against the median, and between two jumps against the straight line over them.
    """
    force, step_s = m.force.force_n, float(np.median(np.diff(m.force.time_s)))
    most = max(round(LONGEST_S / step_s), 1)
    excess = np.asarray(force - median_filter(force, 2 * max(round(0.5 * MEDIAN_S / step_s), 1) + 1, mode="nearest"))
    least = max(SIGMAS * m.force.noise_n, LEAST_N)
    found = []
    for sign in (1.0, -1.0):
        edges = np.flatnonzero(np.diff(np.concatenate([[False], sign * excess > least, [False]]).astype(np.int8)))
        found += [
            Spike(int(first), excess[first:end])
            for first, end in zip(edges[::2], edges[1::2], strict=True)
            if end - first <= most
        ]
    jump, _ = step_excess(force, m.force.time_s, 0.0, m.quiet.stop)
    at = np.flatnonzero(np.abs(jump) > least)
    for before, after in zip(at, at[1:], strict=False):
        if jump[before] * jump[after] < 0.0 and after - before <= most:
            part = slice(int(before) + 1, int(after) + 1)
            line = np.linspace(force[before], force[after + 1], int(after - before) + 2)[1:-1]
            found.append(Spike(int(before) + 1, force[part] - line))
    return found


@finds(
    {"unanswered force spike": "Check cable and amplifier of the load cell, and record the trial again."},
    spoils=PREDICTION,
)
def unanswered_spikes(
    tested: ModelUnderTest, m: MeasuredTrial, p: PredictedAngles, until_s: float
) -> list[SessionFinding]:
    """The worst spike of the force that neither key nor whippen answers, until the release.

    Conventions: counts of key and whippen, from 4 ms before a spike to 8 ms after it, about a straight line. The answer
    is what the model's motion with the spike and without it differ by; its share that is lacking is that of the
    difference from the model, by least squares. Named where all of the answer lacks and its root mean square is five
    times what is left, and five times what the model missed in the 12 ms before. Silent about smaller answers, where
    the model misses the motion anyway, as of a key that rings on its bed, and after the release.
    """
    step_s = float(np.median(np.diff(m.force.time_s)))
    key_per_impulse = 0.5 * AFTER_S * tested.action["drive.point.x"] / tested.action["key.inertia"]
    predicted = np.column_stack([p.change_rad(name) for name in BOTH]) / m.resolution_rad[: len(BOTH)]
    off = np.column_stack([m.change_rad[:, i] / m.resolution_rad[i] for i in range(len(BOTH))]) - predicted
    asked = []
    for spike in candidate_spikes(m):
        part = _window(m, spike, -BEFORE_S, AFTER_S)
        if part.size < FEWEST or m.time_s[part[-1]] > until_s or not np.isfinite(off[part]).all():
            continue
        before = _window(m, spike, -MISSED_S, 0.0)
        missed = max(rms(_about_line(m.time_s[before], off[before])), ROUNDING) if before.size > 2 else ROUNDING
        answer = key_per_impulse * step_s * abs(float(spike.change_n.sum())) / float(m.resolution_rad[0])
        if min(rms(_about_line(m.time_s[part], off[part])), LACKING[1] * answer) >= FEWEST_MISSES * missed:
            asked.append((answer / missed, _isolation(m.force.force_n, spike), missed, spike))
    by_answer = sorted(asked, key=lambda one: one[0], reverse=True)[:MOST_RUN]
    by_isolation = sorted(asked, key=lambda one: one[1], reverse=True)[:MOST_RUN]
    found = []
    for _, _, missed, spike in {id(one[3]): one for one in (*by_answer, *by_isolation)}.values():
        part = _window(m, spike, -BEFORE_S, AFTER_S)
        without = _motion_without(tested, m, spike, part)
        if without is None:
            continue
        of_model, lacks = (_about_line(m.time_s[part], x) for x in (predicted[part] - without, -off[part]))
        share = float((lacks * of_model).sum() / max((of_model**2).sum(), 1e-12))
        size, missed = share * rms(of_model), max(missed, rms(lacks - share * of_model))
        if LACKING[0] <= share <= LACKING[1] and size >= FEWEST_MISSES * missed:
            found.append((size / missed, size, missed, spike))
    if not found:
        return []
    _, size, missed, spike = max(found, key=lambda one: one[0])
    start_s, lasts_ms = float(m.time_s[spike.first]), 1e3 * step_s * spike.change_n.size
    text = (
        f"trial {m.number}: force: key and whippen do not answer a spike that lasts {lasts_ms:.1f} ms and leaves the "
        f"readings beside it by {spike.size_n:+.2g} N, at {start_s:.4f} s: until {1e3 * AFTER_S:g} ms after it they "
        f"lack the {size:.1f} counts (root mean square) by which the model moves for it, and else miss the model by "
        f"{missed:.1f} (limit {FEWEST_MISSES:g} times that)"
    )
    return [SessionFinding("unanswered force spike", m.number, "force", spike.size_n, FEWEST_MISSES, text)]


def _window(m: MeasuredTrial, spike: Spike, after_s: float, until_s: float) -> NDArray[np.intp]:
    """Samples of the encoders from a time after the begin of a spike to one after its begin, or after its end."""
    time = m.force.time_s
    last = spike.last if until_s > 0.0 else spike.first
    ends = [max(time[spike.first] + after_s, time[0]), min(time[last] + until_s, time[-1])]
    return np.arange(*np.searchsorted(m.time_s, ends))


def _isolation(force_n: Array, spike: Spike) -> float:
    """Size of a spike over the root mean square of the force's steps before and after it."""
    steps, reach = np.diff(force_n), 4 * spike.change_n.size
    beside = [steps[max(spike.first - 1 - reach, 0) : spike.first - 1], steps[spike.last + 1 : spike.last + 1 + reach]]
    return abs(spike.size_n) / max(float(np.sqrt(np.mean(np.concatenate(beside) ** 2))), 1e-12)


def _motion_without(tested: ModelUnderTest, m: MeasuredTrial, spike: Spike, part: NDArray[np.intp]) -> Array | None:
    """The model's change of key and whippen, counts, (n, 2), when the spike is taken out; None where it cannot run."""
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


def _about_line(time_s: Array, values: Array) -> Array:
    """Values (n, k) less the straight line through each column."""
    fitted = np.polyfit(time_s - time_s[0], values, 1)
    return np.asarray(values - np.outer(time_s - time_s[0], fitted[0]) - fitted[1])
