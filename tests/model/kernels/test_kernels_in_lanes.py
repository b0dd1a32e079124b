"""A scene's kernels for lanes against its scalar kernels at random states: same physics, each lane its own member."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

import model
from model import Scene, build_scene, load_scene
from model.codegen.load import load_kernels, load_lane_kernels
from model.integrators.methods import get_method
from model.kernels import workspace as W
from model.kernels.lanes import LANES
from model.kernels.layout import MU_A

SCALES = {"key_lift": 1e-3, "shank": 1e-2}  # of the coordinates that effects add; angles of an action: 0.05


@cache
def rest() -> np.ndarray:
    return model.rest_state(model.load_action()).angle_rad


def member(scene: Scene, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """Parameters, angles, speeds and input of a random member: near rest, so that contacts touch, part and slide."""
    p = scene.vector.copy()
    p *= 1.0 + rng.normal(size=len(p)) * rng.choice([0.0, 1e-3])
    first, size = int(scene.tables.offset[1]), 21
    for c in range(len(scene.contacts)):
        if rng.random() < 0.2:
            p[first + size * c + MU_A] = 0.0
    q = np.zeros(scene.size)
    for i, body in enumerate(scene.bodies):
        q[i] = rest()[i] if i < len(rest()) and len(scene.bodies) >= 5 else 0.0286
        if body not in model.BODIES:
            q[i] = 0.0
        q[i] += rng.normal() * SCALES.get(body, 0.05) * rng.choice([0.02, 1.0])
    v = rng.normal(size=scene.size) * rng.choice([1e-3, 0.1, 3.0])
    return p, q, v, float(rng.normal() * 20.0)


def compare(scene: Scene, rounds: int) -> int:
    """Compare linearise, prepare, skip, a stage and, to the bit, stepping; returns how many contacts were closed."""
    n, contacts = scene.size, scene.solved_contacts
    alone, together = load_kernels(scene.tables), load_lane_kernels(scene.tables, LANES)
    rng = np.random.default_rng(5)
    method = get_method("rodas4p").coefficients
    closed = 0
    whole = np.zeros((W.LANE_SIZE, LANES))
    for _ in range(rounds):
        members = [member(scene, rng) for _ in range(LANES)]
        whole[W.IDLE] = 0.0
        numbers = np.array([p for p, _, _, _ in members]).T.copy()
        singles = []
        for lane, (p, q, v, u) in enumerate(members):
            w = np.zeros(W.SIZE)
            w[W.Q : W.Q + n], w[W.V : W.V + n] = q, v
            whole[W.Q : W.Q + n, lane], whole[W.V : W.V + n, lane], whole[W.INPUT, lane] = q, v, u
            alone.linearise(w, p, u)
            singles.append(w)
        together.linearise(whole.ravel(), numbers.ravel())
        step = 10.0 ** rng.uniform(-7, -4, LANES)
        whole[W.STEP_RATE], whole[W.STAGE_STEP], whole[W.INPUT_RATE] = 1.0 / step, 0.25 * step, 0.3 * step
        whole[W.ALLOWANCE : W.ALLOWANCE + n] = 10.0 ** rng.uniform(-9, -2, (n, LANES))
        sound = together.prepare(whole.ravel())
        mask = together.skip(whole.ravel(), numbers.ravel())
        needed, union = whole[W.NEEDED].copy(), 2**contacts - 1
        stages = rng.normal(size=(n, LANES)) * 1e-8
        whole[W.U : W.U + n], whole[W.U + W.WIDTH : W.U + W.WIDTH + n] = stages, 10.0 * stages
        exceeded = together.stage(whole.ravel(), numbers.ravel(), method.a, method.c, 1, mask)
        for lane, ((p, _, _, u), w) in enumerate(zip(members, singles, strict=True)):
            mine = whole[:, lane]
            closed += int(np.sum(w[W.GAP : W.GAP + contacts] < 0.0))
            for start in (W.ACC, W.F_U, W.M_DIAG, W.M_UP):
                same(mine[start : start + n], w[start : start + n])
            for start in (W.STIFF, W.DAMP):
                rows = [start + W.WIDTH * i + j for i in range(n) for j in range(n)]
                same(mine[rows], w[rows])
            for start in (W.ROOM, W.GAP, W.GAP_RATE, W.GAP_ACC, W.KICK, W.SLIDE_RATE):
                same(mine[start : start + contacts], w[start : start + contacts])
            gripping = np.flatnonzero(w[W.SLIDE_RATE : W.SLIDE_RATE + contacts])
            for start in (W.SLIDE, W.GRIP):
                same(mine[start + gripping], w[start + gripping])
            w[W.ALLOWANCE : W.ALLOWANCE + W.WIDTH] = mine[W.ALLOWANCE : W.ALLOWANCE + W.WIDTH]
            assert alone.prepare(w, 0.25 * step[lane]) == sound >> lane & 1
            own = alone.skip(w, p)
            union &= own
            assert needed[lane] == contacts - own.bit_count()
            w[W.U : W.U + n], w[W.U + W.WIDTH : W.U + W.WIDTH + n] = stages[:, lane], 10.0 * stages[:, lane]
            gh, rate, weight = 0.25 * step[lane], 1.0 / step[lane], 0.3 * step[lane]
            left = alone.stage(w, p, method.a, method.c, 1, gh, rate, u, weight, own)
            assert left == exceeded >> lane & 1
            if sound >> lane & 1:
                after = W.U + 2 * W.WIDTH
                rows = [*range(after, after + n), *range(after + W.WIDTH, after + W.WIDTH + n)]
                same(mine[rows], w[rows], 1e-7)
        assert mask == union
        stepping(whole, members, alone, together)
    return closed


def stepping(whole: np.ndarray, members: list[Any], alone: Any, together: Any) -> None:
    """Compare what is done with a step beside forces, to the bit."""
    method = get_method("rodas4p").coefficients
    stages, rows = len(method.b), len(method.dense)
    whole[W.ANGLE_LIMIT], whole[W.SPEED_LIMIT], whole[W.FITTED], whole[W.FRACTION] = 1e-6, 1e-5, 1e-4, 0.3
    whole[W.U + 4 * W.WIDTH : W.U + 2 * W.WIDTH * stages] = whole[W.U] * 1.1
    before = whole.copy()
    numbers = np.array([p for p, _, _, _ in members]).T.copy()
    together.fit(whole.ravel(), numbers.ravel())
    finite = together.end(whole.ravel(), method.b, stages, 0)
    together.dense(whole.ravel(), method.dense, rows, stages, 0)
    together.interpolate(whole.ravel(), rows, 0)
    for lane, (p, _, _, _) in enumerate(members):
        w = before[: W.SIZE, lane].copy()
        alone.fit(w, p)
        assert alone.end(w, method.b, stages, 0) == finite >> lane & 1
        alone.dense(w, method.dense, rows, stages, 0)
        alone.interpolate(w, rows, 0)
        assert w.tobytes() == whole[: W.SIZE, lane].tobytes()
        assert w[W.FITTED] <= before[W.FITTED, lane]


def same(mine: np.ndarray, other: np.ndarray, share: float = 1e-10) -> None:
    np.testing.assert_allclose(mine, other, rtol=1e-7, atol=share * float(np.max(np.abs(other), initial=0.0)))


def test_kernels_of_the_key_in_lanes_are_the_scalar_ones(action: model.Action) -> None:
    choice = load_scene("key")
    assert compare(build_scene(choice.on(action), choice), 60) > 60


def test_kernels_of_all_bodies_in_lanes_are_the_scalar_ones(action: model.Action) -> None:
    assert compare(build_scene(action), 20) > 50
