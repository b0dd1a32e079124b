"""Hammer speed on a bench with a bending shank: error relative to the head's true speed, and coverage by the stated u.

    python benchmarks/shank_speed.py [--seeds 30] [--first 3000] [--kinds forte,piano]

The encoder sits at the butt and picks up the vibration; the truth is the motion of the head beyond the hinge.
"""

from __future__ import annotations

import argparse
import sys
from collections import defaultdict
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import model
from benchmarks.bench_strokes import Stroke, play
from benchmarks.event_coverage import nominal
from validation.events.definitions import Event
from validation.events.detect import find_events
from validation.measurement.trial import measure

KINDS = ("forte", "piano", "double", "staccato", "slow", "fortissimo")


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


def main() -> None:
    """Print a row per kind, speed and detection method."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=30)
    parser.add_argument("--first", type=int, default=3000)
    parser.add_argument("--kinds", default=",".join(KINDS))
    options = parser.parse_args()
    print("kind         speed           found as             n  in 2 u  worst z  rms error  median u")
    for kind in options.kinds.split(","):
        rows = defaultdict(list)
        for seed in range(options.first, options.first + options.seeds):
            for event, true in speeds(kind, seed):
                rows[event.name, event.note.split(" of ")[0][:20]].append(
                    ((event.value - true) / event.u, event.value / true - 1, event.u / true)
                )
        for (name, how), values in sorted(rows.items()):
            z, error, u = np.array(values).T
            print(
                f"{kind:12s} {name:15s} {how:20s} {z.size:3d}   {np.mean(np.abs(z) < 2):.2f}  {np.abs(z).max():7.1f} "
                f"{100 * np.sqrt(np.mean(error**2)):8.2f} % {100 * np.median(u):8.2f} %"
            )


if __name__ == "__main__":
    main()
