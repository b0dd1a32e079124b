"""The film's clock is compared with every encoder whose body was tracked and moved."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from validation.measurement.film_offset import clock_offsets

OFFSET_S = 120e-6


def motion(time_s: np.ndarray) -> np.ndarray:
    return 0.1 / (1.0 + np.exp(-(time_s - 0.1) / 0.004))


def test_the_offset_planted_between_film_and_encoder_is_found_and_a_body_at_rest_is_left_out() -> None:
    time_s, film_s = np.arange(0, 0.2, 2e-4), np.arange(0.02, 0.18, 5e-4)
    encoders = [SimpleNamespace(name=name) for name in ("key", "whippen", "hammer")]
    angles = np.column_stack([motion(time_s), motion(time_s), np.zeros_like(time_s)])
    trial: Any = SimpleNamespace(read=lambda: SimpleNamespace(time_s=time_s, encoders=encoders, angle_rad=angles))
    noise = np.random.default_rng(1).normal(0.0, 1e-5, (film_s.size, 2))
    tracked: Any = SimpleNamespace(
        bodies=("whippen", "hammer"),
        column=("whippen", "hammer").index,
        time_s=film_s,
        angle_rad=np.column_stack([motion(film_s + OFFSET_S), np.zeros(film_s.size)]) + noise,
        u_angle_rad=np.full((film_s.size, 2), 1e-5),
    )
    offsets = clock_offsets(trial, tracked)
    assert list(offsets) == ["whippen"]
    offset, u = offsets["whippen"]
    assert abs(offset - OFFSET_S) < 4 * u and u < 5e-6
