"""Logs of a drive whose numbers are known: a run of a scene read as the sensors of a bench would read it."""

from __future__ import annotations

import numpy as np

import model
from model.drive.readings import driven_scene, static_torque_nm
from model.simulation.statics import solve_rest

RATE_HZ = 5000.0
USUAL = (0.02, 0.02, 2.0 * np.pi / 327680, 5e-3)
"""Noise of force (N) and current (A), width of a count (rad), relative error of the scales."""


def command_of(action: model.Action, scene: model.SceneChoice, seed: int, push_n: float = 22.0) -> np.ndarray:
    """Volts at 5 kHz: a forte, then pushes of random height and length on the key that lies at the bottom."""
    volts_per_n = scene.on(action)["motor_arm.length"] / static_torque_nm(action, scene, 1.0)
    random, out = np.random.default_rng(seed), np.zeros(6000)
    out[:3500] = 0.8 * volts_per_n * np.interp(np.arange(3500) / RATE_HZ, *model.force_table("forte"))
    at = 3600
    while at < 5900:
        length = int(random.integers(25, 120))
        out[at : at + length] = random.uniform(0.2, 1.0) * push_n * volts_per_n
        at += length
    return out


def driven_log(
    action: model.Action,
    scene: model.SceneChoice,
    command_v: np.ndarray,
    seed: int = 0,
    current: bool = True,
) -> model.drive.DriveLog:
    """What a bench with this drive would log."""
    built, (noise_n, noise_a, count, scale) = driven_scene(action, scene), USUAL
    times = np.arange(len(command_v)) / RATE_HZ
    run = model.Simulation(built, model.State(0.0, solve_rest(built), np.zeros(built.size)), 1e-7)
    angle, speed = run.advance(float(times[-1]), times, command_v, held=True, output_time_s=times)
    random = np.random.default_rng(seed)
    force_scale, current_scale = 1.0 + scale * np.clip(random.standard_normal(2), -2.5, 2.5)
    noise = random.standard_normal((2, len(times)))
    arm = angle[:, built.bodies.index("motor")]
    return model.drive.DriveLog(
        time_s=times,
        command_v=command_v,
        force_n=force_scale * run.probe_forces(angle, speed)[:, 0] + noise_n * noise[0],
        arm_rad=count * np.round(arm / count),
        current_a=current_scale * speed[:, built.bodies.index("winding")] + noise_a * noise[1] if current else None,
    )
