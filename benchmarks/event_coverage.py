"""Coverage of the stated uncertainty of every event on held-out strokes, seeds and specimens, and wrong presence.

Prints per kind of stroke and event: how often trial and truth agree that the event occurred, how often it is
ambiguous, the share of errors within 1 and 2 stated u (0.68 and 0.95 for normal errors), the RMS of error over u, and
the largest error.  ``--levels`` also shifts string and key felt within `u_rest_level_m` (±0.1 mm, rectangular).
The truth applies the same definitions to the plant's own motion, ten times finer, without sensors.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from functools import cache

import numpy as np

import model
from benchmarks.bench_strokes import BEFORE_S, FINE, Stroke, play
from benchmarks.runner import Run, Table, may_be
from validation.events.definitions import EVENTS, Event
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


def table(kind: str, found: list[tuple[int, dict, dict]]) -> tuple[int, int]:
    """Print one row per event; errors within two stated u, and errors in all."""
    within = compared = 0
    print(f"\n{kind} (n = {len(found)})")
    shown = Table(
        "event:15s", "compared:d", "ambig:d", "wrong:d", "<1u:.2f", "<2u:.3f", "rms z:.2f", "worst z:.1f",
        "median u:.4f",
        "95% err:.4f", "worst err:.4f", "unit:s", "wrong seeds:s",
    )  # fmt: skip
    for name, event in EVENTS.items():
        errors, count = [], defaultdict(list)
        for seed, true, trial in found:
            t, m = true[name], trial[name]
            count[f"{t.status}/{m.status}"].append(seed)
            if t.status != "absent" and m.status == "found":
                errors.append((m.value - t.value, m.u))
        error, u = np.array(errors).reshape(-1, 2).T
        z = np.abs(error[u > 0] / u[u > 0])
        figures = [np.nan] * 7
        if z.size:
            off = np.abs(error)
            ends = [event.display_factor * x for x in (np.median(u), np.quantile(off, 0.95), off.max())]
            figures = [np.mean(z < 1), np.mean(z < 2), np.sqrt(np.mean(z**2)), z.max(), *ends]
        within, compared = within + int(np.sum(z < 2)), compared + z.size
        ambiguous = sum(len(v) for k, v in count.items() if k.endswith("/ambiguous"))
        wrong = [seed for kind in ("found/absent", "absent/found") for seed in count[kind]]
        shown.row(
            name, len(errors), ambiguous, len(wrong), *figures, event.display_unit, ", ".join(map(str, wrong[:5]))
        )
    return within, compared


def main(run: Run) -> bool:
    """Print the tables; whether 95 % of errors may be within two stated u."""
    seeds = range(run.first, run.first + run.seeds)
    found = [table(kind, list(pairs(kind, seeds, run.rate, run.jitter, run.levels))) for kind in run.kinds]
    return may_be(0.95, *map(sum, zip(*found, strict=True)))


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


def shank_speed(run: Run) -> bool:
    """Hammer speed on a bench whose shank bends: error relative to the head's true speed, coverage by the stated u.

    The encoder sits at the butt and picks up the vibration; the truth is the motion of the head beyond the hinge.
    """
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
