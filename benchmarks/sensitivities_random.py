"""Derivatives at the default tolerances on random parameter sets and forces, against tight ones (1e-12 rad, 1e-8).

    python -m benchmarks sensitivities_random [--sets 24] [--seed 200] [--scene whole]

A set has half of its laws and masses changed by some 15 %, a third of its pivots by 0.1 mm; forces are half sines, slow
ramps, repeated blows, steps and triangles of 3 to 20 N. Errors are those of the worst of 60 columns, as in
`sensitivities.py`; of contact forces also the quantile 0.9999, which leaves out the samples next to a kink.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

import model
from benchmarks.runner import Run, Table, may_be
from benchmarks.sensitivities import ALL, off, sixty
from model.sensitivity import find_parameters

Array = NDArray[np.float64]


def random_blow(random: np.random.Generator) -> tuple[str, tuple[Array, Array]]:
    """A force on the key, and what it is."""
    kind = ("half sine", "slow ramp", "repeated", "two steps", "triangle")[int(random.integers(5))]
    end = float(random.uniform(0.25, 0.45))
    time = np.linspace(0.0, end, int(5000 * end) + 1)
    top, width = float(random.uniform(3.0, 20.0)), float(random.uniform(0.06, 0.15))

    def half_sine(start: float) -> Array:
        return np.asarray(np.sin(np.pi * np.clip((time - start) / width, 0.0, 1.0)))

    if kind == "slow ramp":
        return kind, (time, top * np.clip(time / float(random.uniform(0.15, 0.3)), 0.0, 1.0))
    if kind == "two steps":
        low = top / 3.0
        return kind, (time, np.interp(time, [0.0, 0.01, 0.06, 0.07, 0.2, 0.21], [0.0, low, low, top, top, top / 4.0]))
    if kind == "triangle":
        return kind, (time, np.interp(time, [0.0, width, 2.0 * width], [0.0, top, 0.0]))
    return kind, (time, top * (half_sine(0.0) + (half_sine(1.4 * width) if kind == "repeated" else 0.0)))


def random_set(random: np.random.Generator) -> model.Action:
    """One of the two built-in actions, changed."""
    action = model.load_action("hirschkorn2004" if random.random() < 0.6 else "hirschkorn2004-regulated")
    changed = {}
    for path, q in action.quantities.items():
        number = q.unit not in ("m", "rad") and "second.normal" not in path and q.value > 0.0
        if number and random.random() < 0.5:
            changed[path] = q.value * float(np.exp(random.normal(0.0, 0.15)))
        elif q.unit == "m" and "pivot" in path and random.random() < 0.3:
            changed[path] = q.value + float(random.normal(0.0, 1e-4))
    return action.with_values(changed)


def errors(action: model.Action, blow: tuple[Array, Array], scene: str) -> tuple[float, float, float, float]:
    """Worst errors of angles, of contact forces, their quantile 0.9999, and of events."""
    names = sixty(action)
    scale = np.array([parameter.scale for parameter in find_parameters(action, names)])
    tight = replace(ALL, scene=scene)
    usual = replace(tight, tolerance=model.SensitivityOptions.tolerance,
                    relative_tolerance=model.SensitivityOptions.relative_tolerance)  # fmt: skip
    limit, found = (model.sensitivities(action, blow, names, options=options) for options in (tight, usual))
    if found.absent_events != limit.absent_events:
        print(f"  other events happen: {found.absent_events} {limit.absent_events}")
    assert limit.contact_forces is not None and limit.d_contact_forces is not None
    assert found.d_contact_forces is not None
    angles = off(found.d_angles, limit.d_angles, 1e-4 / np.broadcast_to(scale, limit.d_angles.shape[1:]))
    touched = np.max(limit.contact_forces, axis=0) > 0.0
    least = 1e-3 * np.max(limit.contact_forces, axis=0)[touched, None] / scale
    forces = off(found.d_contact_forces[:, touched], limit.d_contact_forces[:, touched], least)
    events = [0.0]
    for name, d in limit.d_events.items():
        if np.all(np.isfinite(d)):
            size = np.maximum(np.abs(d), 1e-4 * np.max(np.abs(d * scale)) / scale)
            events.append(float(np.max(np.abs(found.d_events[name] - d) / size)))
    return float(np.max(angles)), float(np.max(forces)), float(np.quantile(forces, 0.9999)), max(events)


def main(run: Run) -> bool:
    """Print one line a set, then medians and largest; whether half of the sets are within 1e-5."""

    def case(seed: int, scene: str) -> dict[str, Any]:
        random = np.random.default_rng(seed)
        action = random_set(random)
        kind, blow = random_blow(random)
        try:
            return {"kind": kind, "errors": errors(action, blow, scene)}
        except model.ModelError as error:
            return {"kind": f"{kind}: refused, {error}"}

    rows = []
    table = Table("force:10s", "seed:d", "angles:.1e", "forces:.1e", "0.9999:.1e", "events:.1e")
    for (seed, _), row in run.cases([(run.seed + k, run.scene) for k in range(run.sets)], case):
        rows += [row["errors"]] if "errors" in row else []
        table.row(row["kind"], seed, *row.get("errors", [None] * 4))
    for word, of in (("median", np.median(rows, axis=0)), ("largest", np.max(rows, axis=0))):
        table.row(word, None, *of)
    middle, most = np.median(rows, axis=0), np.max(rows, axis=0)
    run.figure("derivatives-random", " / ".join(f"{middle[k]:.1e} and {most[k]:.1e}" for k in (0, 2, 3)))
    near = sum(row[0] <= 1e-5 for row in rows)
    print(f"angles within 1e-5: {near} of {len(rows)}")
    return may_be(0.5, near, len(rows))
