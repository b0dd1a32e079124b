"""``simulate --key-motion``: what force at the key front a measured motion of the key takes, written and told."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from pianorig.console.output import print_json, run_attributes, write_columns
from pianorig.errors import InputError

if TYPE_CHECKING:
    from model import Action

FAR_FROM_REST_RAD = 5e-4  # 0.1 mm at the key front; most records begin at rest, so the reader is told


def drive_by_motion(
    action: Action,
    table: Path,
    out: Path,
    *,
    also: Sequence[str],
    from_rest: bool,
    tolerance: float,
    output_rate: float | None,
    scene: str,
    method: str,
    as_json: bool,
) -> None:
    """Run ``action`` under the key's motion in ``table``, write the columns to ``out``, print what came out.

    Raises
    ------
    InputError : options in ``also`` that make no sense together with a motion, or a table that cannot be used
    """
    import numpy as np

    import model

    if also:
        raise InputError(f"--key-motion: found together with {', '.join(also)}; give one or the other")
    times, angles = model.read_motion_table(table)
    outputs = None if output_rate is None else model.output_times(times[0], times[-1], output_rate)
    driven = model.simulate_motion(
        action,
        times,
        angles,
        from_rest=from_rest,
        tolerance=tolerance,
        output_time_s=outputs,
        scene=scene,
        method=method,
    )
    lifts = driven.key_tensions()
    write_columns(
        out,
        driven.columns(),
        run_attributes(action, tolerance, method, scene)
        | {
            "key_motion": str(table),
            "coverage_factor_95": driven.coverage_factor,
            "resolution_rad": driven.fit.resolution_rad,
            "jitter_rad": driven.fit.jitter_rad,
            "clock_jitter_s": driven.fit.clock_s,
        },
    )
    largest = int(np.argmax(np.abs(driven.force_n)))
    if as_json:
        print_json(
            {
                "out": out,
                "rows": len(driven.time_s),
                "tolerance_rad": tolerance,
                "first_force_n": driven.force_n[0],
                "largest_force_n": driven.force_n[largest],
                "u_largest_force_n": driven.u_force_n[largest],
                "coverage_factor_95": driven.coverage_factor,
                "resolution_rad": driven.fit.resolution_rad,
                "jitter_rad": driven.fit.jitter_rad,
                "clock_jitter_s": driven.fit.clock_s,
                "key_would_lift": [{"start_s": lift.start_s, "end_s": lift.end_s} for lift in lifts],
                **driven.counters,
            }
        )
        return
    half = driven.coverage_factor * driven.u_force_n[largest]
    print(f"{out}: {len(driven.time_s)} rows, {driven.counters['n_steps']} steps")
    print(
        f"largest force {driven.force_n[largest]:.2f} N +- {half:.2f} N (95 %) at {driven.time_s[largest]:.4f} s; "
        f"key angle read to {driven.fit.resolution_rad:.3g} rad, jitter {driven.fit.jitter_rad:.2g} rad"
    )
    away = driven.angle_rad[0, driven.bodies.index("key")] - driven.rest_rad
    if abs(away) > FAR_FROM_REST_RAD:
        print(
            f"the first angle is {1e3 * away:+.2f} mrad from where this action's key rests: if it rested there, "
            "shift the angles; for changes since rest add --from-rest"
        )
    for lift in lifts:
        print(
            f"key would lift from its rail {1e3 * lift.start_s:.1f} to {1e3 * lift.end_s:.1f} ms: "
            "do not trust the force there"
        )
