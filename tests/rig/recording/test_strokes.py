"""Strokes in a stream: each is found once, whole, with quiet before it; what is no stroke is left alone."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from rig.backend import Block
from rig.configuration.rig_file import load_rig
from rig.recording.strokes import Stroke, StrokeDetector, StrokeSettings

RATE = 5000.0
SETTINGS = StrokeSettings.of(load_rig("virtual").config, RATE)


def played(
    duration_s: float,
    strokes: list[tuple[float, float, float]],
    *,
    seed: int = 1,
    noise_n: float = 0.03,
    drift_n_per_s: float = 0.0,
    change: Callable[[np.ndarray, np.ndarray, np.ndarray], None] | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Force (n,) and counts (n, 3) of strokes (begin, length, peak N), with noise; the key follows the force."""
    random = np.random.default_rng(seed)
    t = np.arange(int(duration_s * RATE)) / RATE
    force, key = np.zeros(t.size), np.zeros(t.size)
    for begin, length, peak in strokes:
        phase = np.clip((t - begin) / length, 0, 1)
        force += peak * np.sin(np.pi * phase) ** 2
        key += -0.04 * np.sin(np.pi * np.clip(phase * 1.02, 0, 1)) ** 2
    if change is not None:
        change(t, force, key)
    force = force + drift_n_per_s * t + noise_n * random.standard_normal(t.size)
    count = np.rint(key[:, None] * [1, -2, 8] / np.array(SETTINGS.rad_per_count)).astype(np.int64)
    return force, count


def found(force: np.ndarray, count: np.ndarray, block: int = 100, settings: StrokeSettings = SETTINGS) -> list[Stroke]:
    detector, strokes = StrokeDetector(settings), []
    for first in range(0, force.size, block):
        part = slice(first, first + block)
        stroke = detector.add(Block(first, force[part], force[part], count[part]))
        assert detector.needed_from <= min(first + block, force.size)
        strokes += [stroke] if stroke else []
    return [*strokes, *filter(None, [detector.finish()])]


@pytest.mark.parametrize("seed", range(20))
def test_every_stroke_is_found_once_and_whole(seed) -> None:
    random = np.random.default_rng(seed)
    begins = np.cumsum(random.uniform(0.8, 2.5, 8)) + 0.3
    truth = [(b, random.uniform(0.06, 0.35), random.uniform(1.5, 60.0)) for b in begins]
    drift = random.uniform(-0.05, 0.05)
    force, count = played(begins[-1] + 2.0, truth, seed=seed, drift_n_per_s=drift)
    strokes = found(force, count, block=int(random.integers(20, 400)))
    assert len(strokes) == len(truth) and {s.status for s in strokes} == {"complete"}
    for stroke, (begin, length, _) in zip(strokes, truth, strict=True):
        assert stroke.first / RATE <= begin - 0.19 and begin - 1e-3 <= stroke.trigger / RATE <= begin + 0.6 * length
        assert begin + length + 0.1 <= stroke.end / RATE <= begin + length + 0.6
    ends = [0, *(s.end for s in strokes)]
    assert all(s.first >= end - 0.21 * RATE for s, end in zip(strokes, ends, strict=False))


def test_the_division_into_blocks_does_not_move_a_beginning() -> None:
    force, count = played(6.0, [(1.2, 0.1, 9.0), (3.0, 0.2, 30.0)])
    begun = [[(s.first, s.trigger) for s in found(force, count, block)] for block in (10, 100, 250)]
    triggers = [[trigger for _, trigger in one] for one in begun]
    assert triggers[0] == triggers[1] == triggers[2]


def test_spikes_drift_and_a_finger_laid_on_the_key_are_no_strokes() -> None:
    def spikes(t: np.ndarray, force: np.ndarray, key: np.ndarray) -> None:
        force[10_000:10_008] += 40.0  # 1.6 ms: a relay
        force += np.where(t > 3.0, np.minimum((t - 3.0) * 0.1, 0.4), 0.0)  # a hand comes to rest

    assert found(*played(12.0, [], change=spikes, drift_n_per_s=0.1)) == []


def test_after_a_finger_stays_on_the_key_strokes_end_and_the_next_is_found() -> None:
    def rests(t: np.ndarray, force: np.ndarray, key: np.ndarray) -> None:
        force += np.where(t > 1.3, 0.9, 0.0)  # from the first stroke on

    strokes = found(*played(6.0, [(1.2, 0.2, 12.0), (3.5, 0.1, 20.0)], change=rests))
    assert [s.status for s in strokes] == ["complete", "complete"] and strokes[1].first / RATE == pytest.approx(
        3.0, abs=0.05
    )


def test_a_key_that_is_held_down_goes_on_until_it_is_let_go_or_too_long() -> None:
    def held(t: np.ndarray, force: np.ndarray, key: np.ndarray) -> None:
        down = (t > 1.25) & (t < 3.0)
        key[down] = -0.04
        force[down] = np.maximum(force[down], 3.0)

    (stroke,) = found(*played(5.0, [(1.2, 0.1, 12.0)], change=held))
    assert stroke.status == "complete" and 3.1 < stroke.end / RATE < 3.6
    first, *_ = found(*played(5.0, [(1.2, 0.1, 12.0)], change=held), settings=replace(SETTINGS, longest_s=1.0))
    assert first.status == "not at rest" and first.end / RATE == pytest.approx(2.2, abs=0.05)


def test_a_slow_press_is_found_by_the_key_and_a_stream_that_begins_within_a_stroke_waits_for_rest() -> None:
    def slow(t: np.ndarray, force: np.ndarray, key: np.ndarray) -> None:
        key[:] = -0.04 * np.clip((t - 2.0) / 1.5, 0, 1) * (t < 4.0)

    (stroke,) = found(*played(6.0, [], change=slow, noise_n=0.01))
    assert 2.0 < stroke.trigger / RATE < 2.2 and stroke.status == "complete"
    strokes = found(*played(5.0, [(-0.1, 0.6, 30.0), (2.5, 0.1, 10.0)]))
    assert len(strokes) == 1 and strokes[0].first / RATE == pytest.approx(2.0, abs=0.05)


def test_what_is_under_way_at_the_end_is_told_and_settings_survive_as_text() -> None:
    *_, last = found(*played(2.0, [(1.9, 0.4, 20.0)]))
    assert last.status == "interrupted" and last.end == 2 * RATE
    assert StrokeSettings.from_text(SETTINGS.to_text()) == SETTINGS
    for text in ("{}", "[]", "3", "x", '{"rad_per_count": 3}'):
        with pytest.raises((TypeError, ValueError, KeyError)):
            StrokeSettings.from_text(text)
