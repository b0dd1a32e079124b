"""What a scene's kernels say of one state."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from model.derived.load import kernels_of
from model.kernels import workspace as W
from model.scene.build import Scene
from model.simulation.run import Simulation


class Evaluation:
    """Accelerations ``a``, mass matrix, forces ``f`` = M a, K, D and df/du of a scene without joints that give."""

    def __init__(self, scene: Scene, q: np.ndarray, v: np.ndarray, u: float, vector: np.ndarray | None = None) -> None:
        n, w = scene.size, np.zeros(W.SIZE)
        w[W.Q : W.Q + n], w[W.V : W.V + n] = q, v
        p = scene.vector if vector is None else vector
        self.touching = kernels_of(scene.tables).linearise(w, p, u)
        self.mass = np.diag(w[W.M_DIAG : W.M_DIAG + n])
        for i, up in enumerate(scene.tables.parent):
            if up >= 0:
                self.mass[i, up] = self.mass[up, i] = w[W.M_UP + i]
        self.stiff, self.damp = (
            w[start : start + W.WIDTH**2].reshape(W.WIDTH, W.WIDTH)[:n, :n].copy() for start in (W.STIFF, W.DAMP)
        )
        self.a, self.f_u = w[W.ACC : W.ACC + n].copy(), w[W.F_U : W.F_U + n].copy()
        self.f = self.mass @ self.a


def stages_off(
    run: Simulation, angles: np.ndarray, speeds: np.ndarray, rows: Iterable[int]
) -> tuple[list[float], set[str]]:
    """How far stages at rows of a run are from those with the Jacobian of differences; contacts whose memory pushed."""
    scene, n, z = run.scene, run.scene.size, len(run.scene.tables.memory)
    kernels = kernels_of(scene.tables)
    w = np.zeros(W.WITH_MEMORY)

    def rates(y: np.ndarray) -> np.ndarray:
        w[W.Q : W.Q + n], w[W.V : W.V + n], w[W.Z : W.Z + z] = y[:n], y[n : 2 * n], y[2 * n :]
        kernels.linearise(w, scene.vector, 12.0)
        return np.concatenate([y[n : 2 * n], w[W.ACC : W.ACC + n], w[W.Z_RATE : W.Z_RATE + z]])

    gh, wrong, checked = 1e-5, [], set[str]()
    for k in rows:
        y = np.concatenate([angles[k], speeds[k], run.remembered[k]])
        sizes = np.concatenate([np.full(n, 1e-9), 1e-6 * (1.0 + np.abs(speeds[k])), 1e-6 * (1.0 + np.abs(y[2 * n :]))])
        columns = []
        for j, size in enumerate(sizes):
            step = size * np.eye(len(y))[j]
            columns.append((rates(y + step) - rates(y - step)) / (2.0 * size))
        right = rates(y)
        if not kernels.prepare(w, gh):
            continue
        kernels.stage(w, scene.vector, np.zeros(64), np.zeros(64), 0, gh, 1.0 / 4e-5, 12.0, 0.0, 0)
        u = np.concatenate([w[W.U : W.U + n], w[W.U + W.WIDTH : W.U + W.WIDTH + n], w[W.Z_U : W.Z_U + z]])
        dense = np.linalg.solve(np.eye(len(y)) / gh - np.column_stack(columns), right)
        parts = (slice(0, n), slice(n, 2 * n), slice(2 * n, None))
        wrong.append(max(np.max(np.abs(u[p] - dense[p])) / (1e-9 + np.max(np.abs(dense[p]))) for p in parts))
        push = w[W.Z_PUSH : W.Z_PUSH + W.LINKS * z].reshape(z, W.LINKS)
        checked |= {scene.contacts[scene.tables.memory[m]] for m in range(z) if np.any(push[m])}
    return wrong, checked
