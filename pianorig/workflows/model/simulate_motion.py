"""``simulate --key-motion``: the force that a measured motion of key, motor arm or finger takes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

import model
from pianorig.console.column_file import run_attributes, write_columns

USELESS_SHARE = 0.5  # half the 95 % interval, of the force
FAR_FROM_REST_RAD = 5e-4  # 0.1 mm at the key front; most records begin at rest, so a larger offset is mentioned


def drive_by_motion(
    action: model.Action,
    table: Path,
    out: Path,
    *,
    from_rest: bool,
    tolerance: float,
    output_rate: float | None,
    scene: str,
    method: str,
) -> model.MotionDriven:
    """Run ``action`` under the key's motion in ``table`` and write the columns to ``out``."""
    times, angles = model.read_motion_table(table, scene)
    driven = model.simulate_motion(
        action,
        times,
        angles,
        from_rest=from_rest,
        tolerance=tolerance,
        output_time_s=None if output_rate is None else model.output_times(times[0], times[-1], output_rate),
        scene=scene,
        method=method,
    )
    attributes = run_attributes(action, tolerance, method, scene) | {"key_motion": str(table)} | _reading(driven)
    write_columns(out, driven.columns(), attributes)
    return driven


def _reading(driven: model.MotionDriven) -> dict[str, float]:
    """How well the key's motion was known."""
    return {
        "coverage_factor_95": driven.coverage_factor,
        "resolution_rad": driven.fit.resolution_rad,
        "jitter_rad": driven.fit.jitter_rad,
        "clock_jitter_s": driven.fit.clock_s,
    }


def motion_facts(driven: model.MotionDriven) -> dict[str, Any]:
    """First and largest force, their uncertainty and where the key would lift, for ``--json``."""
    largest = int(np.argmax(np.abs(driven.force_n)))
    return {
        "rows": len(driven.time_s),
        "first_force_n": driven.force_n[0],
        "largest_force_n": driven.force_n[largest],
        "u_largest_force_n": driven.u_force_n[largest],
        "half_width_share": driven.half_width_share(),
        "interval_useless": bool(driven.half_width_share() > USELESS_SHARE),
        **_reading(driven),
        "key_would_lift": [{"start_s": lift.start_s, "end_s": lift.end_s} for lift in driven.key_tensions()],
        **driven.counters,
    }


def print_motion(driven: model.MotionDriven) -> None:
    """Largest force with its uncertainty, and what makes it doubtful."""
    largest = int(np.argmax(np.abs(driven.force_n)))
    half = driven.coverage_factor * driven.u_force_n[largest]
    print(
        f"largest force {driven.force_n[largest]:.2f} N +- {half:.2f} N (95 %) at {driven.time_s[largest]:.4f} s; "
        f"key angle read to {driven.fit.resolution_rad:.3g} rad, jitter {driven.fit.jitter_rad:.2g} rad"
    )
    share = driven.half_width_share()
    if share > USELESS_SHARE:
        print(
            f"this force is useless: its 95 % interval is +-{100.0 * share:.0f} % of it, because the key's angle is "
            f"read only to {driven.fit.resolution_rad:.2g} rad; use an encoder with finer counts or a slower motion"
        )
    away = driven.fit.at(driven.time_s[:1])[0][0, 0] - driven.rest_rad
    if abs(away) > FAR_FROM_REST_RAD:
        print(
            f"the first angle is {1e3 * away:+.2f} mrad from where it is in this action at rest: if it rested there, "
            "shift the angles; for changes since rest add --from-rest"
        )
    for lift in driven.key_tensions():
        print(
            f"key would lift from its rail {1e3 * lift.start_s:.1f} to {1e3 * lift.end_s:.1f} ms: "
            "do not trust the force there"
        )
