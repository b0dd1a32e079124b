"""The inside view of ``pianorig simulate``: its sums, printed and as JSON, its sheet of figures and its animation."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

import model

DRAWING_RATE_HZ = 10_000.0


def described(action: model.Action) -> dict[str, str]:
    """What each contact is, in the words of the action's file."""
    ending = ".description"
    return {path[: -len(ending)]: words for path, words in action.structure.items() if path.endswith(ending)}


def inside_facts(seen: model.inside.Inside) -> dict[str, object]:
    """Sums of an inside view for ``--json``."""
    contacts = [
        {
            "contact": name,
            "largest_normal_n": seen.largest_normal_n[i],
            "slid_m": seen.slid_m[-1, i],
            "rubbed_j": seen.rubbed_j[-1, i],
            "felt_j": seen.felt_j[-1, i],
        }
        for i, name in enumerate(seen.contacts)
    ]
    joints = [{"joint": body, "rubbed_j": seen.joint_j[-1, i]} for i, body in enumerate(seen.bodies)]
    return {
        "contacts": contacts,
        "joints": joints,
        "key_would_lift": [asdict(one) for one in seen.key_tensions()],
        "key_lifts": [asdict(one) for one in seen.key_lifts()],
    }


def lift_attributes(seen: model.inside.Inside) -> dict[str, list[float]]:
    """Intervals in which the key lifts or would, as attributes of the output file; none where it stays."""
    out = {}
    for name, found in (("key_would_lift", seen.key_tensions()), ("key_lifts", seen.key_lifts())):
        if found:
            out[f"{name}_from_s"], out[f"{name}_to_s"] = [one.start_s for one in found], [one.end_s for one in found]
    return out


def print_inside(seen: model.inside.Inside, words: dict[str, str]) -> None:
    """Table of contacts and joints, then the intervals in which the key lifts or would."""
    print(f"{'contact':<34}{'largest N':>10}{'rubbed mm':>11}{'friction mJ':>13}{'felt mJ':>9}")
    for i, name in enumerate(seen.contacts):
        title = f"{name.removeprefix('contact')} {words[name]}" if name in words else name.replace("_", " ")
        print(
            f"{title:<34}{seen.largest_normal_n[i]:>10.2f}"
            f"{1e3 * seen.slid_m[-1, i]:>11.3f}{1e3 * seen.rubbed_j[-1, i]:>13.4f}{1e3 * seen.felt_j[-1, i]:>9.4f}"
        )
    for tip_n, tip_j in zip(seen.tip_n.T, seen.tip_j.T, strict=True):
        print(f"{'tip of the motor arm':<34}{tip_n.max(initial=0.0):>10.2f}{'':>11}{'':>13}{1e3 * tip_j[-1]:>9.4f}")
    joints = ", ".join(f"{body} {1e3 * seen.joint_j[-1, i]:.4f}" for i, body in enumerate(seen.bodies))
    print(f"joints, friction mJ: {joints}")
    for one in seen.key_tensions():
        print(
            f"key would lift from its balance rail {one.start_s:.4f} to {one.end_s:.4f} s: "
            f"pull to {one.largest_n:.2f} N, {1e3 * one.impulse_ns:.2f} mN s"
        )
    for gone in seen.key_lifts():
        print(
            f"key off its balance rail {gone.start_s:.4f} to {gone.end_s:.4f} s: "
            f"up to {1e3 * gone.largest_m:.3f} mm at {gone.largest_at_s:.4f} s"
        )
    if not seen.key_tensions() and not seen.key_lifts():
        print("key stays on its balance rail")


def draw_inside(
    action: model.Action,
    times: ArrayLike,
    force_n: ArrayLike,
    *,
    figures: Path | None,
    animation: Path | None,
    tolerance: float,
    scene: str,
    method: str,
) -> None:
    """Simulate a blow again at a row rate for drawing; draw its sheet (needs matplotlib) and its animation."""
    times, force_n = model.check_force_table(times, force_n)
    fine = model.output_times(times[0], times[-1], DRAWING_RATE_HZ)
    solution = model.simulate(
        action, times, force_n, output_time_s=fine, inside=True, tolerance=tolerance, scene=scene, method=method
    )
    at = np.interp(fine, times, force_n)
    if figures is not None:
        model.inside.draw_sheet(action, solution, at, figures)
    if animation is not None and animation.suffix == ".html":
        # start-up: the player's data need more of validation and vision than a run without animation
        from pianorig.workflows.model.blow_animation import write_blow_animation

        write_blow_animation(action, solution, at, animation)
    elif animation is not None:
        model.inside.write_animation(action, solution, at, animation)
