"""The noise of a trial's force as knots between which it changes linearly: where they are, and how large it is."""

from __future__ import annotations

import numpy as np

from validation.conventions import Array
from validation.identification.observations import ObservedTrial

SEGMENTS = 24  # of a trial, between which its force noise is taken to change linearly
RISE = 0.75  # share of them before the hammer is up: there the noise of a fast stroke still turns into motion
BEFORE_S = 2e-3  # before the first phase the force is the preload, without noise


def noise_knots(trial: ObservedTrial) -> Array:
    """Times (SEGMENTS + 1,) between which the noise of the force is taken to change linearly.

    They are close together while the hammer rises: segments of equal length left a forte two of them there, and
    its noise went into the friction.
    """
    hammer = np.abs(trial.change_rad[:, 2])
    begin, end = float(trial.time_s[0]), float(trial.force_time_s[-1])
    up = float(trial.time_s[int(np.argmax(hammer > 0.9 * hammer.max()))])
    up = min(max(up, begin + 1e-3), 0.9 * end + 0.1 * begin)
    first = int(RISE * SEGMENTS)
    rise = np.linspace(begin, up, first)
    return np.concatenate([[begin - BEFORE_S], rise, np.linspace(up, end, SEGMENTS + 1 - first)[1:]])


def slow_noise_n(trial: ObservedTrial) -> Array:
    """Standard deviation of white force noise, averaged around each knot but the first, N."""
    step = float(np.median(np.diff(trial.force_time_s)))
    knots = noise_knots(trial)
    length = 0.5 * (np.append(knots[2:], knots[-1]) - knots[:-1])
    return np.asarray(trial.noise_n * np.sqrt(step / length))


def own_units(trial: ObservedTrial) -> Array:
    """Standard deviations (2 + SEGMENTS,) of what a trial has of its own: N of its force, s of its film's clock."""
    return np.concatenate([[trial.u_offset_n], slow_noise_n(trial), [trial.u_film_time_s]])
