"""What a scene's kernels say of one state."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from model import Scene, Simulation
from model.codegen.load import load_kernels
from model.kernels import workspace as W
from tests.model.conftest import random_states


def placed(scene: Scene, q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """A workspace at a state, where that of joints that give follows the coordinates."""
    n, g, w = scene.size, len(scene.pins), np.zeros(W.WITH_MEMORY)
    w[W.Q : W.Q + n], w[W.V : W.V + n] = q[:n], v[:n]
    w[W.Z : W.Z + g], w[W.Z + g : W.Z + 2 * g] = q[n:], v[n:]
    return w


class Evaluation:
    """Accelerations ``a``, mass matrix, forces ``f`` = M a, K, D, df/du, how many contacts touch."""

    def __init__(self, scene: Scene, q: np.ndarray, v: np.ndarray, u: float, vector: np.ndarray | None = None) -> None:
        k, w = len(q), placed(scene, q, v)
        self.w = w
        self.touching = load_kernels(scene.tables).linearise(w, scene.vector if vector is None else vector, u)
        if scene.pins:
            lower, self.stiff, self.damp = (
                w[at : at + W.WIDE**2].reshape(W.WIDE, W.WIDE)[:k, :k] for at in (W.P_MASS, W.P_STIFF, W.P_DAMP)
            )
            self.mass = np.tril(lower) + np.tril(lower, -1).T
            self.a, self.f_u = w[W.P_ACC : W.P_ACC + k], w[W.P_INPUT : W.P_INPUT + k]
        else:
            self.mass = np.diag(w[W.M_DIAG : W.M_DIAG + k])
            for i, up in enumerate(scene.tables.parent[:k]):
                if up >= 0:
                    self.mass[i, up] = self.mass[up, i] = w[W.M_UP + i]
            self.stiff, self.damp = (
                w[at : at + W.WIDTH**2].reshape(W.WIDTH, W.WIDTH)[:k, :k] for at in (W.STIFF, W.DAMP)
            )
            self.a, self.f_u = w[W.ACC : W.ACC + k], w[W.F_U : W.F_U + k]
        self.f = self.mass @ self.a


def states(count: int, scene: Scene, seed: int) -> list[tuple[np.ndarray, np.ndarray, float]]:
    """Random states of the five bodies, with what presses off the key or deep in it, lifts between compressed felt and
    2 mm, the shank bent by 10 mrad and joints giving by tenths of a millimetre; the input as large as its kind is."""
    random = np.random.default_rng(seed)
    spread = {
        "motor": lambda: (random.uniform(-0.02, 0.02), 0.3 * random.normal()),
        "winding": lambda: (random.normal(), 3.0 * random.normal()),
        "finger": lambda: (random.uniform(-0.02, 0.05), 3.0 * random.normal()),
        "key_lift": lambda: (
            random.choice([random.uniform(-4e-4, 5e-6), random.uniform(5e-6, 2e-3)]),
            random.normal() * 10.0 ** random.uniform(-4.0, -0.5),
        ),
        "shank": lambda: (random.uniform(-0.01, 0.01), random.normal() * 10.0 ** random.uniform(-3.0, 1.0)),
    }
    out = []
    for q, v, u in random_states(count, seed):
        more = [spread[name]() for name in scene.bodies[5:]]
        more += [(3e-4 * random.normal(), random.normal() * 10.0 ** random.uniform(-3.0, -0.5)) for _ in scene.pins]
        at, speeds = np.array(more).reshape(-1, 2).T
        out.append((np.append(q, at), np.append(v, speeds), 0.01 * u if "motor" in scene.bodies else u))
    return out


def off_differences(scene: Scene, where: Iterable[tuple[np.ndarray, np.ndarray, float]]) -> tuple[float, float]:
    """Largest part by which K and D are off central differences, and the part of the columns that had any; df/du is
    asserted."""
    h, worst, compared = 1e-7, 0.0, []
    for q, v, u in where:
        at = Evaluation(scene, q, v, u)
        for j, e in enumerate(h * np.eye(len(q))):
            up, down = Evaluation(scene, q + e, v, u), Evaluation(scene, q - e, v, u)
            compared.append(up.touching == down.touching)
            if not compared[-1]:
                continue  # a contact opens inside the difference: no derivative there
            # K = df/dq - (dM/dq) a
            stiff = (up.f - down.f - (up.mass - down.mass) @ at.a) / (2 * h)
            worst = max(worst, np.abs(stiff - at.stiff[:, j]).max() / (1e-3 + np.abs(at.stiff).max()))
            damp = (Evaluation(scene, q, v + e, u).f - Evaluation(scene, q, v - e, u).f) / (2 * h)
            worst = max(worst, np.abs(damp - at.damp[:, j]).max() / (1e-3 + np.abs(at.damp).max()))
        f_u = (Evaluation(scene, q, v, u + 1e-3).f - Evaluation(scene, q, v, u - 1e-3).f) / 2e-3
        np.testing.assert_allclose(f_u, at.f_u, atol=1e-5)
    return worst, float(np.mean(compared))


def stages_off(
    run: Simulation, angles: np.ndarray, speeds: np.ndarray, rows: Iterable[int]
) -> tuple[list[float], set[str]]:
    """How far stages at rows of a run are from those with the Jacobian of differences; contacts whose memory pushed."""
    scene, n, z = run.scene, run.scene.size, len(run.scene.tables.memory)
    kernels = load_kernels(scene.tables)
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
