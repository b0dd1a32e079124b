"""Make the reference trajectories in this folder, by a method that shares nothing with the integrator under test.

Explicit Runge-Kutta of order 8 (SciPy DOP853) at rtol = atol = 1e-12, restarted at every point of the force table, so
that no kink lies inside a step; right-hand side: the compiled accelerations, which the tests check against the
plain NumPy twin. Takes some minutes. Run:  python tests/model/data/make_reference.py
The forte agrees with the project's shared reference (explicit 8th order, 1e-13) to the figure the script prints
where that file is at hand.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from scipy.integrate import DOP853

import model
from model.codegen.load import load_kernels
from model.kernels import workspace as W

HERE = Path(__file__).parent


def blows() -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Force tables by name: 5 kHz, rounded to 1e-4 N so that the files hold them exactly."""
    t = np.round(np.arange(0, 3001) * 2e-4, 4)
    knots = {
        "forte": (
            [0, 0.05, 0.07, 0.09, 0.11, 0.1125, 0.115, 0.118, 0.3, 0.39, 1],
            [0, 0, 1.4, 4.9, 10, 27, 15, 10, 10, 0, 0],
        ),
        "piano": ([0, 0.03, 0.16, 0.165, 0.17, 0.35, 0.45, 1], [0, 0, 1.5, 3.0, 1.5, 1.5, 0, 0]),
    }
    out = {name: (t, np.round(np.interp(t, *k), 4)) for name, k in knots.items()}
    noise = np.random.default_rng(4).normal(0.0, 0.05, len(t))
    out["noisy"] = (t, np.round(out["forte"][1] + noise, 4))
    return out


def explicit(t: np.ndarray, force: np.ndarray, every: int = 10) -> np.ndarray:
    """Rows of time, 5 angles, 5 speeds at every ``every``-th point of the table."""
    action = model.load_action()
    scene = model.build_scene(action)
    n = scene.size
    linearise, w = load_kernels(scene.tables).linearise, np.zeros(W.SIZE)

    y = np.concatenate([model.rest_state(action).angle_rad, np.zeros(n)])
    rows = [np.concatenate([[t[0]], y])]
    step = 1e-6
    for k in range(len(t) - 1):
        slope = (force[k + 1] - force[k]) / (t[k + 1] - t[k])

        def rhs(time: float, y: np.ndarray, k: int = k, slope: float = slope) -> np.ndarray:
            u = force[k] + slope * (time - t[k])
            w[W.Q : W.Q + n], w[W.V : W.V + n] = y[:n], y[n:]
            linearise(w, scene.vector, u)
            return np.concatenate([y[n:], w[W.ACC : W.ACC + n]])

        solver = DOP853(rhs, t[k], y, t[k + 1], rtol=1e-12, atol=1e-12, first_step=min(step, t[k + 1] - t[k]))
        while solver.status == "running":
            solver.step()
            if solver.t < t[k + 1]:
                step = solver.step_size
        if solver.status != "finished":
            raise SystemExit(f"failed at {t[k]}")
        y = solver.y
        if (k + 1) % every == 0:
            rows.append(np.concatenate([[t[k + 1]], y]))
        if k % 500 == 0:
            print(f"  t = {t[k]:.3f} s", file=sys.stderr)
    return np.array(rows)


def main() -> None:
    names = ["time_s", *(f"{b}_rad" for b in model.BODIES), *(f"{b}_rad_per_s" for b in model.BODIES)]
    for name, (t, force) in blows().items():
        np.savetxt(
            HERE / f"{name}_force.csv", np.column_stack([t, force]), "%.4f", ",", header="time_s,force_n", comments=""
        )
        rows = explicit(t, force)
        np.savetxt(HERE / f"{name}_reference.csv", rows, "%.12g", ",", header=",".join(names), comments="")
        print(name, len(rows), "rows")


if __name__ == "__main__":
    main()
