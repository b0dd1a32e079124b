"""Coverage of the stated uncertainty of every event on held-out strokes, seeds and specimens, and wrong presence.

    python benchmarks/event_coverage.py [--seeds 200] [--first 1000] [--kinds forte,piano] [--rate 5000] [--jitter 0]
                                        [--levels] [--json FILE]

Prints per kind of stroke and event: how often trial and truth agree that the event occurred, how often it is
ambiguous, the share of errors within 1 and 2 stated u (0.68 and 0.95 for normal errors), the RMS of error over u, and
the largest error.  ``--levels`` also shifts string and key felt within `u_rest_level_m` (±0.1 mm, rectangular).
The truth applies the same definitions to the plant's own motion, ten times finer, without sensors.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections import defaultdict
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import model
from benchmarks.bench_strokes import BEFORE_S, FINE, KINDS, MISREGULATED, Stroke, play
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


def table(kind: str, found: list[tuple[int, dict, dict]]) -> list[dict]:
    """One row per event."""
    rows = []
    for name in EVENTS:
        z, error, u, count = [], [], [], defaultdict(list)
        for seed, true, trial in found:
            t, m = true[name], trial[name]
            count[f"{t.status}/{m.status}"].append(seed)
            if t.status != "absent" and m.status == "found":
                error.append(m.value - t.value)
                u.append(m.u)
                if m.u > 0:
                    z.append(error[-1] / m.u)
        z, error = np.array(z), np.abs(error)
        ambiguous = sum(len(v) for k, v in count.items() if k.endswith("/ambiguous"))
        wrong = {k: v for k, v in count.items() if k in ("found/absent", "absent/found")}
        rows.append(
            {
                "kind": kind, "event": name, "n": len(found), "compared": len(error), "ambiguous": ambiguous,
                "truth_ambiguous": sum(len(v) for k, v in count.items() if k.startswith("ambiguous/")),
                "wrong": sum(map(len, wrong.values())), "wrong_seeds": [s for v in wrong.values() for s in v][:5],
                "in_1u": float(np.mean(np.abs(z) < 1)) if z.size else float("nan"),
                "in_2u": float(np.mean(np.abs(z) < 2)) if z.size else float("nan"),
                "rms_z": float(np.sqrt(np.mean(z**2))) if z.size else float("nan"),
                "worst_z": float(np.abs(z).max()) if z.size else float("nan"),
                "median_u": float(np.median(u)) if u else float("nan"),
                "p95_error": float(np.quantile(error, 0.95)) if error.size else float("nan"),
                "worst_error": float(error.max()) if error.size else float("nan"),
            }
        )  # fmt: skip
    return rows


def show(rows: list[dict]) -> None:
    """Print the rows of one kind."""
    print(f"\n{rows[0]['kind']} (n = {rows[0]['n']})")
    print("  event           compared ambig wrong  <1u   <2u  rms z worst z   median u   95% err   worst err")
    for r in rows:
        factor, unit = EVENTS[r["event"]].display_factor, EVENTS[r["event"]].display_unit
        print(
            f"  {r['event']:15s} {r['compared']:7d} {r['ambiguous']:5d} {r['wrong']:5d}  {r['in_1u']:.2f}  "
            f"{r['in_2u']:.3f} {r['rms_z']:5.2f} {r['worst_z']:6.1f} {factor * r['median_u']:10.4f} "
            f"{factor * r['p95_error']:9.4f} {factor * r['worst_error']:10.4f} {unit} {r['wrong_seeds'] or ''}"
        )


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=200)
    parser.add_argument("--first", type=int, default=1000)
    parser.add_argument("--kinds", default=",".join([*KINDS, *MISREGULATED]))
    parser.add_argument("--rate", type=float, default=5000.0)
    parser.add_argument("--jitter", type=float, default=0.0)
    parser.add_argument("--levels", action="store_true")
    parser.add_argument("--json")
    options = parser.parse_args()
    everything = []
    for kind in options.kinds.split(","):
        seeds = range(options.first, options.first + options.seeds)
        rows = table(kind, list(pairs(kind, seeds, options.rate, options.jitter, options.levels)))
        show(rows)
        everything += rows
    if options.json:
        with open(options.json, "w", encoding="utf-8") as file:
            json.dump(everything, file, indent=1)


if __name__ == "__main__":
    main()
