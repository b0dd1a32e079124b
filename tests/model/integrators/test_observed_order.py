"""The compiled step loop shows the order of its method on the real equations: free swing, equal steps."""

from __future__ import annotations

import numpy as np
import pytest

import model
from model.integrators import METHODS, CoupledTableau, RosenbrockTableau

STEPS = np.array([4e-3, 2e-3, 1e-3, 5e-4])
END = 0.08


@pytest.fixture(scope="module")
def free() -> model.Scene:
    """No contact and no friction: smooth, coupled pendulums (whippen, jack and repetition hang together)."""
    off = {"jack_spring": 0, "repetition_spring": 0}
    off |= {f"contact{i:02d}": 0 for i in range(1, 14)}
    off |= {f"{b}.joint_friction": 0 for b in model.BODIES}
    return model.build_scene(model.load_action(overrides=off))


def swing(
    scene: model.Scene, method: str, step: float, tolerance: float, at: np.ndarray
) -> tuple[np.ndarray, dict[str, int]]:
    """Angles and speeds (m, 10) at the times ``at``, and the work done."""
    start = np.array([0.03, 0.02, 0.3, 0.6, 0.3])
    run = model.Simulation(
        scene, model.State(0.0, start, np.zeros(5), step), tolerance=tolerance, method=method, largest_step_s=step
    )
    time = np.linspace(0.0, END, 9)
    angles, speeds = run.advance(END, time, 3.0 * np.ones(9), output_time_s=at)
    return np.hstack([angles, speeds]), run.work()


# Order 5 from an estimate of order 3: the iteration must leave less than the tolerance that the estimate needs, so the
# tolerance falls with the step's fourth power; longer steps keep rounding out of sight.
COUPLED_STEPS = np.array([8e-3, 4e-3, 2e-3, 1e-3])


@pytest.mark.parametrize("method", METHODS)
def test_order_at_the_end_and_inside_the_steps(free: model.Scene, method: str) -> None:
    inside = np.array([0.0103, 0.0257, 0.0451, 0.0659])
    at = np.append(inside, END)
    truth, _ = swing(free, "rodas5p", 1e-4, 1e-12, at)
    ends, dense = [], []
    coupled = isinstance(METHODS[method], CoupledTableau)
    steps = COUPLED_STEPS if coupled else STEPS
    for step in steps:
        # an iteration stops by the tolerance, so it must be tight enough for its rest not to show
        tolerance = 1e-2 if isinstance(METHODS[method], RosenbrockTableau) else 1e-5
        if coupled:
            tolerance = 3e-4 * (step / COUPLED_STEPS[0]) ** 4
        rows, work = swing(free, method, step, tolerance, at)
        assert work["n_rejected"] == 0
        assert work["n_steps"] == round(END / step)  # equal steps: error control never speaks
        error = np.abs(rows - truth)
        ends.append(error[-1].max())
        dense.append(error[:-1].max())
    order = np.polyfit(np.log(steps), np.log(ends), 1)[0]
    order_inside = np.polyfit(np.log(steps), np.log(dense), 1)[0]
    assert METHODS[method].order - 0.3 < order < METHODS[method].order + 1.2
    assert order_inside > METHODS[method].dense_order - 0.2


@pytest.mark.parametrize("method", [m for m in METHODS if not isinstance(METHODS[m], RosenbrockTableau)])
def test_a_method_that_keeps_no_account_of_energy_says_so(free: model.Scene, method: str) -> None:
    with pytest.raises(model.InputError, match=f"{method} keeps no account"):
        model.Simulation(free, model.State(0.0, np.zeros(5), np.zeros(5)), method=method, energy=True)
