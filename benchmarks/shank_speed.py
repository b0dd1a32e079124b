"""Hammer speed on a bench with a bending shank: error relative to the head's true speed, and coverage by the stated u.

    python -m benchmarks shank_speed [--seeds 30] [--first 3000] [--kinds forte,piano]

The encoder sits at the butt and picks up the vibration; the truth is the motion of the head beyond the hinge.
"""

from __future__ import annotations

from collections import defaultdict

import numpy as np

import model
from benchmarks.bench_strokes import Stroke, play
from benchmarks.event_coverage import nominal
from benchmarks.runner import Run, Table, may_be
from validation.events.definitions import Event
from validation.events.detect import find_events
from validation.measurement.trial import measure


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


def main(run: Run) -> bool:
    """Print a row per kind, speed and detection method; whether 95 % of errors may be within two stated u."""
    within = compared = 0
    table = Table(
        "kind:12s",
        "speed:15s",
        "found as:20s",
        "n:3d",
        "in 2 u:.2f",
        "worst z:.1f",
        "rms error %:.2f",
        "u %:.2f",
    )
    for kind in run.kinds:
        rows = defaultdict(list)
        for seed in range(run.first, run.first + run.seeds):
            for event, true in speeds(kind, seed):
                rows[event.name, event.note.split(" of ")[0][:20]].append(
                    ((event.value - true) / event.u, event.value / true - 1, event.u / true)
                )
        for (name, how), values in sorted(rows.items()):
            z, error, u = np.array(values).T
            within, compared = within + int(np.sum(np.abs(z) < 2)), compared + z.size
            shares = 100 * np.sqrt(np.mean(error**2)), 100 * np.median(u)
            table.row(kind, name, how, z.size, np.mean(np.abs(z) < 2), np.abs(z).max(), *shares)
    return may_be(0.95, within, compared)
