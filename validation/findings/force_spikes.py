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
from validation.conventions import BODIES, Array
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
"""The comparison begins that long before a spike, so that what the model misses anyway is known."""
FEWEST_COUNTS = 3.0
"""Root mean square of the difference from the model that can be a lacking answer."""
UNANSWERED = 1 / 3
"""Of that difference, left when the spike is taken out: planted spikes leave 0 to 0.32, true ones 0.52 and more."""
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

    Conventions: the difference of key and whippen from the model, counts, root mean square about a straight line from 4
    ms before a spike to 8 ms after it. Named where that is 3 counts or more under the force as recorded, and a third
    of it without the spike. Silent about a spike whose answer would be smaller, 1 ms of 2 N on a key that rests on its
    bed, and after the release, where the key leaves the arm and its rail by ways that the model may lack.
    """
    step_s = float(np.median(np.diff(m.force.time_s)))
    key_per_impulse = 0.5 * AFTER_S * tested.action["drive.point.x"] / tested.action["key.inertia"]
    measured = np.column_stack([m.change_rad[:, i] / m.resolution_rad[i] for i in range(len(BOTH))])
    off = measured - np.column_stack([p.change_rad(name) for name in BOTH]) / m.resolution_rad[: len(BOTH)]
    asked = []
    for spike in candidate_spikes(m):
        part = _window(m, spike)
        if part.size < FEWEST or m.time_s[part[-1]] > until_s or not np.isfinite(off[part]).all():
            continue
        missed = _rms_about_line(m.time_s[part], off[part])
        impulse_n_s = step_s * abs(float(spike.change_n.sum()))
        lacking = min(missed, key_per_impulse * impulse_n_s / float(m.resolution_rad[0]))
        if lacking >= FEWEST_COUNTS:
            asked.append((lacking, _isolation(m.force.force_n, spike), missed, spike))
    by_answer = sorted(asked, key=lambda one: one[0], reverse=True)[:MOST_RUN]
    by_isolation = sorted(asked, key=lambda one: one[1], reverse=True)[:MOST_RUN]
    found = []
    for _, _, missed, spike in {id(one[3]): one for one in (*by_answer, *by_isolation)}.values():
        without = _missed_without(tested, m, spike, measured)
        if without < UNANSWERED * missed:
            found.append((missed, without, spike))
    if not found:
        return []
    missed, without, spike = max(found, key=lambda one: one[0] - one[1])
    start_s, lasts_ms = float(m.time_s[spike.first]), 1e3 * step_s * spike.change_n.size
    text = (
        f"trial {m.number}: force: key and whippen do not answer a spike that lasts {lasts_ms:.1f} ms and leaves the "
        f"readings beside it by {spike.size_n:+.2g} N, at {start_s:.4f} s: until {1e3 * AFTER_S:g} ms after it the "
        f"model misses them by {missed:.1f} counts with the spike and by {without:.1f} without it (limits "
        f"{FEWEST_COUNTS:g} counts, and a third of it)"
    )
    return [SessionFinding("unanswered force spike", m.number, "force", spike.size_n, UNANSWERED, text)]


def _window(m: MeasuredTrial, spike: Spike) -> NDArray[np.intp]:
    """Samples of the encoders around a spike and after it."""
    time = m.force.time_s
    ends = [max(time[spike.first] - BEFORE_S, time[0]), min(time[spike.last] + AFTER_S, time[-1])]
    return np.arange(*np.searchsorted(m.time_s, ends))


def _isolation(force_n: Array, spike: Spike) -> float:
    """Size of a spike over the root mean square of the force's steps before and after it."""
    steps, reach = np.diff(force_n), 4 * spike.change_n.size
    beside = [steps[max(spike.first - 1 - reach, 0) : spike.first - 1], steps[spike.last + 1 : spike.last + 1 + reach]]
    return abs(spike.size_n) / max(float(np.sqrt(np.mean(np.concatenate(beside) ** 2))), 1e-12)


def _missed_without(tested: ModelUnderTest, m: MeasuredTrial, spike: Spike, measured: Array) -> float:
    """By how much the model misses both encoders, counts, when the spike is taken out; infinite where it cannot run."""
    part = _window(m, spike)
    until = int(np.searchsorted(m.force.time_s, m.time_s[part[-1]])) + 2
    time_s, force_n = m.force.time_s[:until], m.force.force_n[:until].copy()
    force_n[spike.first : spike.last + 1] -= spike.change_n
    rest = tested.load(m.force.preload_n).rest

    def run() -> float:
        try:
            made = tested.simulate(
                tested.action, time_s, force_n, tolerance=tested.tolerance, output_time_s=m.time_s[part], initial=rest
            )
        except ModelError:
            return float("inf")
        angle = np.asarray(made.angle_rad, dtype=float)[:, [BODIES.index(name) for name in BOTH]]
        return _rms_about_line(m.time_s[part], measured[part] - angle / m.resolution_rad[: len(BOTH)])

    inputs = (tested.identity, time_s, force_n, m.force.preload_n, m.time_s[part], measured[part])
    return float(tested.store.value("force spike", inputs, run))


def _rms_about_line(time_s: Array, values: Array) -> float:
    """Root mean square of values (n, k) about the straight line through each column."""
    fitted = np.polyfit(time_s - time_s[0], values, 1)
    return float(np.sqrt(np.mean((values - np.outer(time_s - time_s[0], fitted[0]) - fitted[1]) ** 2)))
