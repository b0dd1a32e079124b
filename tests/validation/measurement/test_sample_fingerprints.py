"""A trial is known again by the samples of its motion, and by nothing that two strokes may have alike."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rig import TrialData
from validation.measurement.sample_fingerprints import are_same_samples, are_same_stroke, sample_fingerprints


def stroke(make, peak_n: float, width_s: float) -> TrialData:
    """A trial whose baseline reads alike for every stroke, to the bit."""
    time_s = np.arange(5000) / 5000.0
    noise = np.random.default_rng(1).normal(0.0, 0.02, time_s.size)
    way = np.clip((time_s - 0.4) / width_s, 0.0, 1.0)
    force = noise + peak_n * np.sin(np.pi * way) + 0.1 * np.sin(2 * np.pi * 60.0 * time_s)
    change = np.outer(way**2 * (0.05 + 1e-3 * peak_n), (1.0, -2.0, 8.0))
    return make.trial(1, time_s, force, change)


@pytest.fixture
def forte(make) -> TrialData:
    return stroke(make, 30.0, 0.30)


def cut(data: TrialData, first: int, last: int) -> TrialData:
    rows = slice(first, last)
    parts = {name: getattr(data, name)[rows] for name in ("raw_force_n", "force_raw", "motor_command_v")}
    count = data.encoder_count[rows] - data.encoder_count[first]
    return replace(data, **parts, time_s=data.time_s[: last - first], encoder_count=count)


def test_strokes_with_one_baseline_are_two(make, forte):
    piano = stroke(make, 8.0, 0.40)
    np.testing.assert_array_equal(forte.force_raw[:1900], piano.force_raw[:1900])
    one, other = sample_fingerprints(forte), sample_fingerprints(piano)
    assert min(len(one), len(other)) > 10 and not are_same_samples(one, other)


def test_a_cut_of_a_stroke_is_the_stroke_and_an_overlap_shares_its_samples(forte):
    whole = sample_fingerprints(forte)
    assert are_same_stroke(whole, sample_fingerprints(cut(forte, 1000, 4500)))
    early, late = sample_fingerprints(cut(forte, 0, 2800)), sample_fingerprints(cut(forte, 2500, 5000))
    assert are_same_samples(early, late) and not are_same_stroke(early, late)
