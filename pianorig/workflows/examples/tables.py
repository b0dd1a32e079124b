"""Example tables: force of a blow, motion of the key, loading of a felt, a recording by another program."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

import model

Table = dict[str, NDArray[np.float64]]
ENCODER_COUNTS = {"key": 327680, "whippen": 327680, "hammer": 163840}
PRELOAD_N = 0.05
QUIET_S = 0.3
FELT_DEPTH_M = 5e-4
FELT_LOSS = 0.12
"""Half of the difference between pressing and releasing, of the force between them."""
PRESS_BETA, PRESS_ETA = (0.15,), (0.2,)
"""Half width of the loop as a share of the force, and the reach of its memory as a share of the depth."""
NOISE_N = 0.02


def force_table(name: str) -> Table:
    """A blow of the force library."""
    time_s, force_n = model.force_table(name)
    return {"time_s": time_s, "force_n": force_n}


def simulated_blow() -> model.Solution:
    """The motion of the built-in action under the example force."""
    return model.simulate(model.load_action(), *model.force_table("forte"))


def key_motion(blow: model.Solution) -> Table:
    """The key's angle since rest, in whole counts of an encoder as a bench would record it."""
    step = 2.0 * np.pi / ENCODER_COUNTS["key"]
    turned = blow.angle_rad[:, 0] - blow.angle_rad[0, 0]
    return {"time_s": blow.time_s, "key_rad": np.round(turned / step) * step}


def felt_loading() -> Table:
    """One press and release of the felt at the key front: its cubic (eq. 2.5), a loop about it, noise of the cell."""
    action = model.load_action()
    a, b, c = (action[f"contact02.normal.{name}"] for name in "abc")
    pressed = np.linspace(0.0, FELT_DEPTH_M, 60)
    middle = ((a * pressed + b) * pressed + c) * pressed
    noise = np.random.default_rng(2).normal(0.0, NOISE_N, 2 * pressed.size)
    force = np.concatenate([middle * (1 + FELT_LOSS), (middle * (1 - FELT_LOSS))[::-1]]) + noise
    return {"displacement_m": np.concatenate([pressed, pressed[::-1]]), "force_n": force}


def felt_presses() -> dict[str, Table]:
    """Presses of a felt that remembers: three speeds to three depths, with the noise of the cell."""
    action, rng = model.load_action(), np.random.default_rng(4)
    a, b, c = (action[f"contact02.normal.{name}"] for name in "abc")
    law = model.felt.Hysteresis(a, b, c, PRESS_BETA, PRESS_ETA)
    out = {}
    for depth_mm in (0.2, 0.35, 0.5):
        for speed_mm_per_s in (2, 10, 50):
            seconds = 2.0 * depth_mm / speed_mm_per_s
            time_s = np.linspace(0.0, seconds, 301)
            depth_m = 1e-3 * (depth_mm - speed_mm_per_s * np.abs(time_s - 0.5 * seconds))
            force_n = law.response(time_s, depth_m).force_n + rng.normal(0.0, NOISE_N, time_s.size)
            out[f"{depth_mm}mm_{speed_mm_per_s}mm_per_s"] = {
                "time_s": time_s, "displacement_m": depth_m, "force_n": force_n
            }  # fmt: skip
    return out


def lab_recording(blow: model.Solution) -> Table:
    """The blow as another program would have recorded it: newtons and encoder counts, a quiet time first."""
    rate_hz = 1.0 / float(blow.time_s[1] - blow.time_s[0])
    quiet = round(QUIET_S * rate_hz)
    _, force_n = model.force_table("forte")
    noise = np.random.default_rng(3).normal(0.0, NOISE_N, quiet + force_n.size)
    columns: Table = {
        "time_s": np.arange(quiet + force_n.size) / rate_hz,
        "force_n": np.concatenate([np.zeros(quiet), force_n]) + noise,
    }
    for body, counts in ENCODER_COUNTS.items():
        angle = blow.angle_rad[:, model.BODIES.index(body)]
        turned = np.round((angle - angle[0]) * counts / (2.0 * np.pi))
        columns[f"{body}_counts"] = np.concatenate([np.zeros(quiet), turned])
    return columns


def table_text(columns: Table) -> str:
    """CSV, with as many digits as the numbers need."""
    rows = zip(*(column.tolist() for column in columns.values()), strict=True)
    return "\n".join([",".join(columns), *(",".join(f"{value:.9g}" for value in row) for row in rows)]) + "\n"
