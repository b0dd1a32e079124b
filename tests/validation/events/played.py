"""Strokes of the virtual bench as trials, with the events of the plant's own motion on a time base ten times finer."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache

import numpy as np

import model
from tests.validation.bench_strokes import BEFORE_S, FINE, Stroke, play
from validation.events.definitions import Event
from validation.events.detect import find_events
from validation.measurement.geometry import geometry_of, motion_of
from validation.measurement.trial import U_REST_LEVEL_M, measure

PRELOAD_N = 0.05
LEVEL_M = 0.1e-3


@cache
def nominal() -> tuple[model.Action, object]:
    """The action under test and its geometry."""
    action = model.load_action()
    return action, geometry_of(action, model.rest_state(action, force_n=PRELOAD_N).angle_rad)


def true_events(stroke: Stroke, rate_hz: float, moved: bool) -> dict[str, Event]:
    """Events of the plant's own motion."""
    quiet = int((BEFORE_S - 0.02) * rate_hz * FINE)
    angle = stroke.truth.angle_rad[:, :5]
    rest = angle[:quiet].mean(axis=0)
    geometry = geometry_of(stroke.truth.action, rest) if moved else nominal()[1]
    motion = motion_of(geometry, stroke.truth.time_s, (angle - rest)[:, [0, 1, 4]], np.full(3, 1e-9))
    return find_events(motion, quiet)


def pairs(kind: str, seeds: range, rate_hz: float, jitter: float, levels: bool) -> Iterator[tuple[int, dict, dict]]:
    """True and measured events of each seed."""
    for seed in seeds:
        changed = {}
        if levels:
            by = np.random.default_rng([seed, 97]).uniform(-LEVEL_M, LEVEL_M, 2)
            changed = {"contact12.second.y": float(by[0]), "contact02.first.y": float(by[1])}
        stroke = play(kind, seed, rate_hz=rate_hz, jitter_counts=jitter, changed=changed)
        measured = measure(stroke.data, None, nominal()[1], u_rest_level_m=U_REST_LEVEL_M if levels else 0.0)
        yield seed, true_events(stroke, rate_hz, levels), find_events(measured.motion, measured.quiet.stop)


def head_height_m(stroke: Stroke) -> np.ndarray:
    """Distance of the head below the string with its shank bent, on the fine time base."""
    a, hammer, bent = stroke.truth.action, stroke.truth.angle_rad[:, 4], stroke.truth.column("shank")
    effect = a.effects if "shank.hinge.x" in a.effects else a.quantities
    hx, hy = (effect[f"shank.hinge.{axis}"].value for axis in "xy")
    x, y = a["contact12.first.x"], a["contact12.first.y"]

    def rise(at: np.ndarray, dx: float, dy: float) -> np.ndarray:
        return dx * np.sin(at) + dy * np.cos(at)

    straight = model.observables.hammer_height_m(a, stroke.truth.angle_rad[:, :5])
    return straight + rise(hammer, x, y) - rise(hammer, hx, hy) - rise(hammer + bent, x - hx, y - hy)


def true_speeds(stroke: Stroke) -> tuple[float, float]:
    """Speed of the head at first contact with the string and at separation, m/s."""
    height, step = head_height_m(stroke), stroke.truth.time_s[1] - stroke.truth.time_s[0]
    touch = int(np.flatnonzero(height <= 0)[0])
    leave = touch + int(np.flatnonzero(height[touch:] > 0)[0])
    return (height[touch - 4] - height[touch - 1]) / (3 * step), (height[leave + 3] - height[leave]) / (3 * step)


def speeds(kind: str, seed: int) -> list[tuple[Event, float]]:
    """Detected hammer and rebound speeds, each with its true value."""
    stroke = play(kind, seed, effects=("shank",))
    measured = measure(stroke.data, None, nominal()[1])
    found = find_events(measured.motion, measured.quiet.stop)
    return list(zip((found["hammer_speed"], found["rebound_speed"]), true_speeds(stroke), strict=True))
