"""The noise of a trial's force as knots between which it changes linearly: where they are, and how large it is."""

from __future__ import annotations

import numpy as np

from validation.conventions import Array
from validation.identification.observations import ObservedTrial

SEGMENTS = 36  # of a trial, between which its force noise is taken to change linearly
EVENLY = 0.15  # share of them that is spread evenly over time
BEFORE_S = 2e-3  # before the force acts it is the preload, without noise; over so long the noise comes up


def noise_knots(trial: ObservedTrial) -> Array:
    """Times (SEGMENTS + 1,) between which the noise of the force is taken to change linearly.

    They begin where the force first differs from the preload: a soft stroke's first phase is later. Between two of them
    the action moves equally far, but for the share that is spread over time: where a stroke rises twice, noise
    of the second rise in long parts went into friction and felt.
    """
    end = float(trial.force_time_s[-1])
    acts = np.flatnonzero(trial.force_n != trial.force_n[0])
    first = min(float(trial.time_s[0]), float(trial.force_time_s[acts[0]] if acts.size else end))
    at = np.unique(np.concatenate([[first], trial.time_s[trial.time_s < end], [end]]))
    passed = (1.0 - EVENLY) * np.linspace(0.0, 1.0, at.size) + EVENLY * (at - first) / (end - first)
    return np.concatenate([[first - BEFORE_S], np.interp(np.linspace(0.0, 1.0, SEGMENTS), passed, at)])


def slow_noise_n(trial: ObservedTrial) -> Array:
    """Standard deviation of white force noise, averaged around each knot but the first, N."""
    step = float(np.median(np.diff(trial.force_time_s)))
    knots = noise_knots(trial)
    length = 0.5 * (np.append(knots[2:], knots[-1]) - knots[:-1])
    return np.asarray(trial.noise_n * np.sqrt(step / length))


def own_units(trial: ObservedTrial) -> Array:
    """Standard deviations (2 + SEGMENTS,) of what a trial has of its own: N of its force, s of its film's clock."""
    return np.concatenate([[trial.u_offset_n], slow_noise_n(trial), [trial.u_film_time_s]])
