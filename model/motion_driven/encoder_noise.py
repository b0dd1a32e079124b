"""Noise of encoder angles: width of a count, readings that repeat one rounding error, jitter of angle and clock."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def resolution_of(angle_rad: Array) -> float:
    """Width of a count (rad) where all angles are whole multiples of one apart, else 0."""
    step = np.diff(np.unique(angle_rad))
    step = step[step > 1e-12]
    if len(step) == 0:
        return 0.0
    smallest = float(step.min())
    smallest = float(np.median(step[step < 1.5 * smallest]))
    multiples = step / smallest
    return smallest if np.max(np.abs(multiples - np.round(multiples))) < 1e-3 else 0.0


def runs_of(angle_rad: Array) -> Array:
    """How many equal readings in a row each sample belongs to."""
    edges = np.concatenate([[0], np.flatnonzero(np.diff(angle_rad)) + 1, [len(angle_rad)]])
    length = np.diff(edges)
    return np.repeat(length, length).astype(float)


def repeated_share(resolution_rad: float, jitter_rad: float) -> float:
    """Share of the rounding's variance that stays the same from sample to sample while nothing moves.

    The mean of a rounded, jittering reading is a sawtooth of the true angle whose harmonics the jitter damps; where
    the angle may lie anywhere within a count its variance is this sum. Without jitter everything stays (share 1).
    """
    k = np.arange(1, 40)
    damping = np.exp(-((2.0 * np.pi * k * jitter_rad / resolution_rad) ** 2))
    return float(np.sum(damping / k**2) / np.sum(1.0 / k**2))


def noise_of(variance: Array, speed: Array, weight: Array) -> tuple[float, float]:
    """Jitter of the angle (rad) and of the clock (s): a and b >= 0 of variance = a^2 + b^2 speed^2, least squares."""
    square = speed**2
    total, cross, fourth = np.sum(weight), np.sum(weight * square), np.sum(weight * square**2)
    mean, slope = np.sum(weight * variance), np.sum(weight * variance * square)
    determinant = total * fourth - cross**2
    if determinant > 1e-9 * total * fourth:
        b = (total * slope - cross * mean) / determinant
        a = (mean - b * cross) / total
        if a >= 0.0 and b >= 0.0:
            return float(np.sqrt(a)), float(np.sqrt(b))
        if b > 0.0:
            return 0.0, float(np.sqrt(max(0.0, slope / fourth)))
    return float(np.sqrt(max(0.0, mean / total))), 0.0
