"""Observed order of a method on the real equations, with equal steps; also for the methods of the benchmarks."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

import model
from model import KeyMotion, build_scene
from model.simulation.statics import solve_rest

END = 0.08
STEPS = (4e-3, 2e-3, 1e-3, 5e-4)
PRESCRIBED_STEPS = (1e-3, 5e-4, 2.5e-4, 1.25e-4)


def free_scene() -> model.Scene:
    """No contact and no friction: smooth, coupled pendulums (whippen, jack and repetition hang together)."""
    off = {"jack_spring": 0, "repetition_spring": 0}
    off |= {f"contact{i:02d}": 0 for i in range(1, 14)}
    off |= {f"{b}.joint_friction": 0 for b in model.BODIES}
    return model.build_scene(model.load_action(overrides=off))


def swing(scene: model.Scene, method: str, step: float, tolerance: float, at: np.ndarray) -> tuple[np.ndarray, dict]:
    """Angles and speeds (m, 10) at the times ``at``, and the work done."""
    start = np.array([0.03, 0.02, 0.3, 0.6, 0.3])
    run = model.Simulation(
        scene, model.State(0.0, start, np.zeros(5), step), tolerance=tolerance, method=method, largest_step_s=step
    )
    time = np.linspace(0.0, END, 9)
    angles, speeds = run.advance(END, time, 3.0 * np.ones(9), output_time_s=at)
    return np.hstack([angles, speeds]), run.work()


def free_orders(
    scene: model.Scene, method: str, steps: Sequence[float] = STEPS, tolerances: Sequence[float] = (1e-2,) * 4
) -> tuple[float, float]:
    """Order at the end of the free swing, and inside the steps."""
    at = np.array([0.0103, 0.0257, 0.0451, 0.0659, END])
    truth, _ = swing(scene, "rodas5p", 1e-4, 1e-12, at)
    errors = []
    for step, tolerance in zip(steps, tolerances, strict=True):
        rows, work = swing(scene, method, step, tolerance, at)
        assert work["n_rejected"] == 0
        assert work["n_steps"] == round(END / step)  # equal steps: error control never speaks
        errors.append(np.abs(rows - truth))
    ends, inside = [e[-1].max() for e in errors], [e[:-1].max() for e in errors]
    end, dense = (float(np.polyfit(np.log(steps), np.log(e), 1)[0]) for e in (ends, inside))
    return end, dense


def prescribed_order(action: model.Action, method: str, steps: Sequence[float] = PRESCRIBED_STEPS) -> float:
    """Order of a whippen riding on the capstan of a swinging key; one if df/dt were missing."""
    smooth = action.with_values({"whippen.joint_friction": 0, "contact01.friction": 0})
    choice = model.SceneChoice(bodies=("key", "whippen"))
    turn = np.array([100.0, -60.0, 0.0, 0.0, 0.0, 0.028])  # 8 mrad down in 0.12 s, pressed all the way
    motion = KeyMotion(np.array([0.0, 0.12]), turn[None])
    scene = build_scene(smooth, choice=choice, key_motion=motion)
    rest = solve_rest(scene, 0.0)
    at = np.array([0.021, 0.0833, 0.12])

    def run(step: float, tolerance: float) -> np.ndarray:
        state = model.State(0.0, rest, np.zeros(1), step)
        simulation = model.Simulation(scene, state, tolerance=tolerance, method=method, largest_step_s=step)
        angles, speeds = simulation.advance(0.12, np.array([0.0, 0.12]), np.array([0.0, 0.12]), output_time_s=at)
        assert simulation.work()["n_rejected"] == 0
        return np.hstack([angles, speeds])

    truth = run(1e-5, 1e-9)
    errors = [np.abs(run(step, 1e-2) - truth)[-1].max() for step in steps]
    return float(np.polyfit(np.log(steps), np.log(errors), 1)[0])
