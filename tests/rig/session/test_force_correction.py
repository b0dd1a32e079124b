"""Quiet interval and corrected force: rules that must hold exactly."""

from __future__ import annotations

import numpy as np
import pytest

from rig import RigInputError, correct_force, find_quiet

RATE_HZ = 5000.0


def record(onset_s=0.4, noise_n=0.02, length_s=1.0, seed=1, hum=0.0):
    time = np.arange(int(length_s * RATE_HZ)) / RATE_HZ
    rng = np.random.default_rng(seed)
    blow = 10 * np.clip((time - onset_s) / 0.05, 0, 1)
    force = 0.2 + blow + hum * np.sin(2 * np.pi * 60 * time) + rng.normal(0, noise_n, time.size)
    return time, force, blow


@pytest.mark.parametrize("hum", [0.0, 0.5])
def test_the_onset_is_found_with_and_without_hum(hum):
    time, force, _ = record(hum=hum)
    quiet = find_quiet(time, force, mains_hz=60.0)
    # the ramp passes 5 sigma (0.1 N) 0.5 ms after it begins; walking back ends within noise of its foot
    assert quiet.onset_s == pytest.approx(0.4, abs=1.5e-3)
    assert quiet.end_s == pytest.approx(quiet.onset_s - 0.01, abs=0.6e-3)
    assert quiet.start_s == 0.0


def test_an_encoder_that_moves_first_ends_the_quiet_interval():
    time, force, _ = record()
    counts = np.zeros((time.size, 3), dtype=np.int64)
    counts[int(0.25 * RATE_HZ) :, 1] = 4
    assert find_quiet(time, force, counts).end_s == pytest.approx(0.25 - 0.01, abs=1e-3)
    counts[counts == 4] = 3  # within jitter
    assert find_quiet(time, force, counts).end_s == pytest.approx(0.39, abs=2e-3)


def test_a_baseline_that_is_too_short_says_what_is_needed():
    time, force, _ = record(onset_s=0.024)
    with pytest.raises(RigInputError, match=r"quiet baseline is 1\d ms; at least 20 ms are needed"):
        find_quiet(time, force)


def test_a_record_without_a_blow_is_refused():
    time, force, blow = record()
    with pytest.raises(RigInputError, match="never leaves its baseline"):
        find_quiet(time, force - blow)


def test_a_record_of_a_few_samples_is_refused():
    time, force, _ = record(length_s=0.03)
    with pytest.raises(RigInputError, match="too short"):
        find_quiet(time, force)


def test_the_group_delay_moves_the_time_axis_and_never_the_values():
    time, force, _ = record()
    quiet = find_quiet(time, force)
    plain = correct_force(time, force, quiet)
    late = correct_force(time, force, quiet, group_delay_s=0.0013, u_group_delay_s=1e-4)
    np.testing.assert_array_equal(late.force_n, plain.force_n)
    np.testing.assert_allclose(late.time_s, time - 0.0013, atol=1e-15)
    # a late clock matters where the force changes: 200 N/s × 0.1 ms on the ramp
    ramp = (time > 0.41) & (time < 0.44)
    extra = np.sqrt(late.u_force_n[ramp] ** 2 - plain.u_force_n[ramp] ** 2)
    assert np.median(extra) == pytest.approx(0.02, rel=0.5)


def test_the_declared_preload_is_what_the_baseline_means():
    time, force, blow = record()
    quiet = find_quiet(time, force)
    corrected = correct_force(time, force, quiet, preload_n=0.07, u_preload_n=0.03)
    assert corrected.force_n[: quiet.stop].mean() == pytest.approx(0.07, abs=1e-12)
    assert np.abs(corrected.force_n - blow - 0.07).max() < 0.1
    assert corrected.u_force_n.min() > 0.03


def test_a_slow_drift_of_the_baseline_is_no_blow_and_the_onset_is_when_the_force_acted():
    time, force, _ = record(noise_n=0.004)
    drifting = force + 0.05 * np.sin(2 * np.pi * 1.5 * time)
    quiet = find_quiet(time, drifting, group_delay_s=0.008)
    assert quiet.onset_s == pytest.approx(0.4 - 0.008, abs=2e-3)
    assert quiet.length_s > 0.37


def test_nothing_is_smoothed():
    time, force, _ = record()
    quiet = find_quiet(time, force)
    corrected = correct_force(time, force, quiet)
    assert not corrected.hum.accepted
    np.testing.assert_allclose(np.diff(corrected.force_n), np.diff(force), atol=1e-12)


def test_lost_force_samples_are_refused_with_their_place():
    time, force, _ = record()
    quiet = find_quiet(time, force)
    force[3000:3004] = np.nan
    for refuse in (lambda: correct_force(time, force, quiet), lambda: find_quiet(time, force)):
        with pytest.raises(RigInputError, match=r"4 lost samples, the first at 0\.6000 s"):
            refuse()
