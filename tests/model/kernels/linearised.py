"""What a scene's kernels say of one state."""

from __future__ import annotations

import numpy as np

from model.derived.load import kernels_of
from model.kernels import workspace as W
from model.scene.build import Scene


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
