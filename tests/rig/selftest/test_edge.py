"""The edge of a push is found to a tenth of a millisecond, however the arm rings, with an uncertainty that covers."""

from __future__ import annotations

import numpy as np
import pytest

from rig.selftest.run import fit_edge, push_response, push_train, without_hum

RATE = 5000.0
AT = 10.03


def response(
    hz: float, damping: float, late_s: float, random: np.random.Generator, noise_n: float = 0.007
) -> np.ndarray:
    t = np.maximum((np.arange(750) - AT) / RATE - late_s, 0.0)
    w = 2 * np.pi * hz
    wd, decay = w * np.sqrt(1 - damping**2), w * damping
    force = 0.25 * (1 - np.exp(-decay * t) * (np.cos(wd * t) + decay / wd * np.sin(wd * t)))
    return force + noise_n * random.standard_normal(t.size)


@pytest.mark.parametrize(("hz", "damping"), [(560, 0.05), (200, 0.2), (1000, 0.1), (1800, 0.5), (120, 0.1)])
@pytest.mark.parametrize("late_s", [-1e-4, 0.0, 3e-4, 8e-3])
def test_a_delay_is_found_within_a_tenth_of_a_millisecond(hz, damping, late_s) -> None:
    random = np.random.default_rng([int(hz), int(1e6 * (late_s + 1))])
    edge = fit_edge(response(hz, damping, late_s, random), RATE, AT)
    assert edge is not None and abs(edge.late_s - late_s) < 1e-4
    assert abs(edge.late_s - late_s) < 4 * edge.u_s + 5e-6


def test_without_a_push_there_is_no_edge() -> None:
    random = np.random.default_rng(1)
    assert fit_edge(-response(560, 0.05, 0.0, random), RATE, AT) is None
    assert fit_edge(np.full(750, np.nan), RATE, AT) is None


def test_hum_that_repeats_with_the_pushes_is_taken_off() -> None:
    volts = push_train(0.02, RATE)
    t = np.arange(volts.size) / RATE
    hum = 0.05 * np.sin(2 * np.pi * 60 * t + 0.3) + 0.02 * np.cos(2 * np.pi * 180 * t)
    mean, plateau = push_response(without_hum(12 * volts + 0.2 + hum, RATE, 60.0, 0), RATE, 0)
    assert plateau == pytest.approx(0.24, abs=1e-3) and np.abs(mean[5:700] - 0.24).max() < 5e-3
