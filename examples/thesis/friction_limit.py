"""The limit that the smoothed friction of thesis eq. 2.10 approaches as its threshold speed falls: set-valued friction.

The action's equations are written out here once more, for bodies on pins, felt of the thesis's law and a key that a
force presses, and stepped by Moreau's midpoint scheme: positions half a step on, forces there, then speeds and friction
impulses together. With w = D^T v the sliding and joint speeds at the end of a step and r the impulses, each r lies in
its Coulomb interval, w = 0 inside it, and w opposes r at its ends. The intervals come from the felt forces of the step,
so the problem is convex, and projected Gauss-Seidel solves it. A pair that stuck holds up to the static coefficient.

Source: J. J. Moreau, "Unilateral contact and dry friction in finite freedom dynamics" (1988); thesis eqs 2.4 to 2.12.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

import model

Array = NDArray[np.float64]

THRESHOLDS = (1e-2, 1e-3, 1e-4, 1e-5)  # m/s
STEP_S = 2.5e-6
TOLERANCE = 1e-7  # rad, of the smoothed motions
CREEP_S = 0.05  # end of the hold over which the drift is fitted
SWEEPS = 300
SWEEPS_BETWEEN_ACTIVE_SETS = 6
REGULARISATION = 1e-10  # more pairs than coordinates: the impulses share the load
CONVERGED = 1e-9  # change of a sliding or joint speed by an impulse, m/s or rad/s
LINE, CIRCLE, ARC = range(3)


class Mechanism(NamedTuple):
    """An action as arrays: bodies b, contacts c; index b stands for the ground."""

    parent: Any  # (b,)
    pivot: Any  # (b, 2) m, in the frame of the parent
    center: Any  # (b, 2) m
    mass: Any  # (b,) kg
    inertia: Any  # (b,) kg m^2
    spring: Any  # (b, 3) torque N m, stiffness N m/rad, angle rad
    joint: Any  # (b, 2) kinetic friction torque N m, static over kinetic
    drive: Any  # (2,) m, on body 0
    gravity: float
    surfaces: Any  # (c, 2) bodies
    first: Any  # (c, 3) x, y, radius
    shape: Any  # (c,)
    second: Any  # (c, 5) x, y, then the line's normal, or radius and the arc's ends
    felt: Any  # (c, 4) a, b, c, D
    rub: Any  # (c, 2) kinetic coefficient, static over kinetic


def read_mechanism(action: model.Action) -> Mechanism:
    """Arrays of an action; exits where its scene or its felts are not the thesis's."""
    contacts = [f"contact{k:02d}" for k in range(1, 14)]
    others = [c for c in contacts if action.law(c) != "hunt-crossley"]
    if action.scene or others:
        raise SystemExit(f"friction limit: found {action.scene or others}, allowed an action without scene and laws")
    bodies, structure = (*model.BODIES, "ground"), action.structure

    def point(path: str) -> list[float]:
        return [action[f"{path}.x"], action[f"{path}.y"]]

    def friction(path: str) -> list[float]:
        z = np.linspace(0.0, 50.0, 50_001)
        hump = action[f"{path}.B1"] * z / (1.0 + action[f"{path}.B2"] * z**4)
        return [action[f"{path}.A"], max(1.0, float(np.max(np.tanh(z) + hump)))]

    def second(contact: str) -> list[float]:
        path = f"{contact}.second"
        match structure[f"{path}.shape"]:
            case "line":
                normal = np.array(point(f"{path}.normal"))
                return [*point(path), *(normal / np.linalg.norm(normal)), 0.0]
            case "circle":
                return [*point(path), action[f"{path}.radius"], 0.0, 0.0]
            case _:
                return [*point(path), *(action[f"{path}.{k}"] for k in ("radius", "arc_start", "arc_end"))]

    springs = {structure[f"{s}.body"]: s for s in ("jack_spring", "repetition_spring")}
    return Mechanism(
        parent=np.array([bodies.index(structure[f"{b}.parent"]) for b in model.BODIES]),
        pivot=np.array([point(f"{b}.pivot") for b in model.BODIES]),
        center=np.array([point(f"{b}.center_of_mass") for b in model.BODIES]),
        mass=np.array([action[f"{b}.mass"] for b in model.BODIES]),
        inertia=np.array([action[f"{b}.inertia"] for b in model.BODIES]),
        spring=np.array(
            [
                [action[f"{springs[b]}.{k}"] if b in springs else 0.0 for k in ("torque", "stiffness", "angle")]
                for b in model.BODIES
            ]
        ),
        joint=np.array([friction(f"{b}.joint_friction") for b in model.BODIES]),
        drive=np.array(point("drive.point")),
        gravity=action["gravity.g"],
        surfaces=np.array([[bodies.index(structure[f"{c}.{k}.body"]) for k in ("first", "second")] for c in contacts]),
        first=np.array([[*point(f"{c}.first"), action[f"{c}.first.radius"]] for c in contacts]),
        shape=np.array([["line", "circle"].index(s) if (s := structure[f"{c}.second.shape"]) in ("line", "circle")
                        else ARC for c in contacts]),
        second=np.array([second(c) for c in contacts]),
        felt=np.array([[action[f"{c}.normal.{k}"] for k in ("a", "b", "c", "D")] for c in contacts]),
        rub=np.array([friction(f"{c}.friction") for c in contacts]),
    )  # fmt: skip


@njit
def _rotate(pose, body, x, y):  # type: ignore[no-untyped-def]
    return pose[body, 2] * x - pose[body, 3] * y, pose[body, 3] * x + pose[body, 2] * y


@njit
def _contact_geometry(mechanism, c, pose):  # type: ignore[no-untyped-def]
    """Depth of a contact, its normal from the second surface to the first, and the centre of the first."""
    one, two = mechanism.surfaces[c]
    x, y, radius = mechanism.first[c]
    px, py = _rotate(pose, one, x, y)
    cx, cy = pose[one, 0] + px, pose[one, 1] + py
    given = mechanism.second[c]
    px, py = _rotate(pose, two, given[0], given[1])
    ux, uy = cx - pose[two, 0] - px, cy - pose[two, 1] - py
    if mechanism.shape[c] == LINE:
        nx, ny = _rotate(pose, two, given[2], given[3])
        return radius - ux * nx - uy * ny, nx, ny, cx, cy
    reach, far = radius + given[2], math.sqrt(ux * ux + uy * uy)
    if mechanism.shape[c] == ARC:
        bx, by = _rotate(pose, two, math.cos(given[3]), math.sin(given[3]))
        ex, ey = _rotate(pose, two, math.cos(given[4]), math.sin(given[4]))
        before, after = bx * uy - by * ux < 0.0, ex * uy - ey * ux > 0.0
        at_begin, at_end = ux * bx + uy * by, ux * ex + uy * ey
        if before and (at_begin >= at_end or not after):
            return reach - at_begin, bx, by, cx, cy
        if after:
            return reach - at_end, ex, ey, cx, cy
    return reach - far, ux / far, uy / far, cx, cy


@njit
def _evaluate(mechanism, q, v, u, acceleration, inverse, pressed):  # type: ignore[no-untyped-def]
    """Acceleration (b,) without friction, inverse mass matrix, and of each contact its force and its slides (b,)."""
    n, contacts = q.shape[0], pressed.shape[0]
    pose, omega = np.zeros((n + 1, 4)), np.zeros(n + 1)  # x, y, cosine, sine
    angle = np.zeros(n + 1)
    pose[n, 2] = 1.0
    for i in range(n):
        up = mechanism.parent[i]
        px, py = _rotate(pose, up, mechanism.pivot[i, 0], mechanism.pivot[i, 1])
        angle[i], omega[i] = angle[up] + q[i], omega[up] + v[i]
        pose[i, 0], pose[i, 1] = pose[up, 0] + px, pose[up, 1] + py
        pose[i, 2], pose[i, 3] = math.cos(angle[i]), math.sin(angle[i])
    mass, force = np.zeros((n, n)), np.zeros(n)
    for i in range(n):
        up = mechanism.parent[i]
        px, py = _rotate(pose, i, mechanism.center[i, 0], mechanism.center[i, 1])
        cx, cy = pose[i, 0] + px, pose[i, 1] + py
        ax = -(omega[i] ** 2) * px - omega[up] ** 2 * (pose[i, 0] - pose[up, 0])
        ay = -(omega[i] ** 2) * py - omega[up] ** 2 * (pose[i, 1] - pose[up, 1])
        fx, fy = -mechanism.mass[i] * ax, -mechanism.mass[i] * (mechanism.gravity + ay)
        j = i
        while j < n:
            jx, jy = cx - pose[j, 0], cy - pose[j, 1]
            force[j] += jx * fy - jy * fx
            k = i
            while k < n:
                along = jx * (cx - pose[k, 0]) + jy * (cy - pose[k, 1])
                mass[j, k] += mechanism.mass[i] * along + mechanism.inertia[i]
                k = mechanism.parent[k]
            j = mechanism.parent[j]
        force[i] += mechanism.spring[i, 0] - mechanism.spring[i, 1] * (q[i] - mechanism.spring[i, 2])
    px, _ = _rotate(pose, 0, mechanism.drive[0], mechanism.drive[1])
    force[0] -= px * u
    for c in range(contacts):
        pressed[c] = 0.0
        depth, nx, ny, cx, cy = _contact_geometry(mechanism, c, pose)
        if depth <= 0.0:
            continue
        middle = mechanism.first[c, 2] - 0.5 * depth
        hx, hy = cx - middle * nx, cy - middle * ny
        push, slide, rate = np.zeros(n), np.zeros(n), 0.0
        for side in range(2):
            sign = 1.0 - 2.0 * side
            k = mechanism.surfaces[c, side]
            while k < n:
                rx, ry = hx - pose[k, 0], hy - pose[k, 1]
                push[k] += sign * (rx * ny - ry * nx)
                slide[k] += sign * (rx * nx + ry * ny)
                k = mechanism.parent[k]
        for k in range(n):
            rate -= push[k] * v[k]
        a, b, linear, damping = mechanism.felt[c]
        normal = ((a * depth + b) * depth + linear) * depth * (1.0 + damping * rate)
        if normal > 0.0:
            pressed[c, 0] = normal
            pressed[c, 1:] = slide
            force += normal * push
    inverse[:] = np.linalg.inv(mass)
    acceleration[:] = inverse @ force


class Pairs(NamedTuple):
    """Contacts, then joints: rows of D^T and (M^-1 D)^T (k, b), own effect, bound and impulse (k,), 1 where stuck."""

    along: Any
    given: Any
    own: Any
    bound: Any
    impulse: Any
    sticks: Any


@njit
def _sweep(pairs, change):  # type: ignore[no-untyped-def]
    """Give each pair in turn the impulse that stops it, within its bound; return the largest speed that changed."""
    along, given, own, bound, impulse, _ = pairs
    worst = 0.0
    for j in range(bound.shape[0]):
        if bound[j] <= 0.0:
            continue
        new = min(max(impulse[j] - np.dot(along[j], change) / own[j], -bound[j]), bound[j])
        step = new - impulse[j]
        impulse[j] = new
        change += given[j] * step
        worst = max(worst, abs(step) * own[j])
    return worst


@njit
def _solve_active_set(pairs, change):  # type: ignore[no-untyped-def]
    """Stop all pairs inside their bounds at once: what many sweeps creep towards where light and heavy bodies stick.

    Where an impulse would pass its bound it ends there, and the others go on without it.
    """
    along, given, _, bound, impulse, _ = pairs
    for _ in range(bound.shape[0]):
        free = np.flatnonzero((bound > 0.0) & (np.abs(impulse) < bound))
        m = free.shape[0]
        if m == 0:
            return
        system, right = np.zeros((m, m)), np.zeros(m)
        for x in range(m):
            right[x] = -np.dot(along[free[x]], change)
            for y in range(m):
                system[x, y] = np.dot(along[free[x]], given[free[y]])
            system[x, x] *= 1.0 + REGULARISATION
        step = np.linalg.solve(system, right)
        share, last = 1.0, -1
        for x in range(m):
            j = free[x]
            left = bound[j] - impulse[j] if step[x] > 0.0 else bound[j] + impulse[j]
            if abs(step[x]) * share > left:
                share, last = left / abs(step[x]), x
        for x in range(m):
            j = free[x]
            new = impulse[j] + share * step[x]
            if x == last:
                new = bound[j] if step[x] > 0.0 else -bound[j]
            change += given[j] * (new - impulse[j])
            impulse[j] = new
        if last < 0:
            return


@njit
def _bound_impulses(mechanism, pressed, inverse, h, pairs):  # type: ignore[no-untyped-def]
    """Directions of all pairs and bounds of their impulses in a step, from what the contacts press with."""
    contacts = pressed.shape[0]
    for j in range(pairs.bound.shape[0]):
        if j < contacts:
            kinetic, ratio = mechanism.rub[j]
            pairs.bound[j] = h * kinetic * pressed[j, 0]
            pairs.along[j] = pressed[j, 1:]
        else:
            kinetic, ratio = mechanism.joint[j - contacts]
            pairs.bound[j] = h * kinetic
            pairs.along[j, j - contacts] = 1.0
        if pairs.bound[j] <= 0.0:
            pairs.impulse[j], pairs.sticks[j] = 0.0, 0
            continue
        pairs.bound[j] *= ratio if pairs.sticks[j] else 1.0
        pairs.given[j] = inverse @ pairs.along[j]
        pairs.own[j] = np.dot(pairs.along[j], pairs.given[j])


class Kept(NamedTuple):
    """Angles and speeds (m, b), and whether contacts, then joints, stick (m, c + b), at the ends that are kept."""

    angle: Any
    speed: Any
    sticks: Any


@njit
def _step_along(mechanism, q, v, inputs, h, every, kept):  # type: ignore[no-untyped-def]
    """Step under the inputs (k,) at the midpoints; keep every ``every``-th end. Return the most sweeps of a step."""
    n, contacts = q.shape[0], mechanism.shape.shape[0]
    count = contacts + n
    a, inverse, pressed = np.zeros(n), np.zeros((n, n)), np.zeros((contacts, 1 + n))
    pairs = Pairs(
        np.zeros((count, n)), np.zeros((count, n)), np.ones(count), np.zeros(count), np.zeros(count),
        np.ones(count, dtype=np.int64),
    )  # fmt: skip
    most, change = 0, np.zeros(n)
    for k in range(inputs.shape[0]):
        middle, mean = q + 0.5 * h * v, v.copy()
        for _ in range(2):  # once more with the mean speed of the step, for felt that damps
            _evaluate(mechanism, middle, mean, inputs[k], a, inverse, pressed)
            _bound_impulses(mechanism, pressed, inverse, h, pairs)
            change[:] = v + h * a
            for j in range(count):
                pairs.impulse[j] = min(max(pairs.impulse[j], -pairs.bound[j]), pairs.bound[j])
                change += pairs.given[j] * pairs.impulse[j]
            sweep = 0
            while sweep < SWEEPS:
                sweep += 1
                if sweep % SWEEPS_BETWEEN_ACTIVE_SETS == 0:
                    _solve_active_set(pairs, change)
                if _sweep(pairs, change) < CONVERGED:
                    break
            most = max(most, sweep)
            mean[:] = 0.5 * (v + change)
        for j in range(count):
            pairs.sticks[j] = 1 if pairs.bound[j] > 0.0 and abs(pairs.impulse[j]) < pairs.bound[j] else 0
        q[:] = middle + 0.5 * h * change
        v[:] = change
        if (k + 1) % every == 0:
            row = (k + 1) // every
            kept.angle[row], kept.speed[row], kept.sticks[row] = q, v, pairs.sticks
    return most


class SetValued(NamedTuple):
    """A blow with set-valued friction, and which contacts, then joints, stick (m, c + b)."""

    solution: model.Solution
    sticks: NDArray[np.int64]
    step_s: float


def simulate(action: model.Action, time_s: Array, force_n: Array, step_s: float = STEP_S) -> SetValued:
    """Predict a blow with set-valued friction under an evenly spaced force table; exits where no motion is found."""
    mechanism = read_mechanism(action)
    spacing = float(time_s[1] - time_s[0])
    every = max(1, math.ceil(spacing / step_s - 1e-9))
    h, m = spacing / every, len(time_s)
    n, contacts = len(model.BODIES), len(mechanism.shape)
    inputs = np.interp(time_s[0] + h * (np.arange(every * (m - 1)) + 0.5), time_s, force_n)
    kept = Kept(np.zeros((m, n)), np.zeros((m, n)), np.zeros((m, contacts + n), dtype=np.int64))
    angles, speeds, sticks = kept
    angles[0] = model.rest_state(action).angle_rad
    most = _step_along(mechanism, angles[0].copy(), speeds[0].copy(), inputs, h, every, kept)
    if most >= SWEEPS or not np.all(np.isfinite(angles)):
        raise SystemExit(f"friction limit: no motion found in steps of {h:g} s; take a shorter step")
    normal = np.zeros((m, contacts))
    a, inverse, pressed = np.zeros(n), np.zeros((n, n)), np.zeros((contacts, 1 + n))
    for k in range(m):
        _evaluate(mechanism, angles[k], speeds[k], 0.0, a, inverse, pressed)
        normal[k] = pressed[:, 0]
    names = tuple(f"contact{k:02d}" for k in range(1, contacts + 1))
    return SetValued(model.Solution(model.BODIES, time_s, angles, speeds, names, normal, action=action), sticks, h)


def run(
    action: model.Action, time_s: Array, force_n: Array, step_s: float = STEP_S
) -> tuple[list[str], dict[str, Any]]:
    """The smoothed law at falling threshold speeds beside set-valued friction: lines of text, and the numbers."""
    limit, coarse = (simulate(action, time_s, force_n, step) for step in (step_s, 2.0 * step_s))
    ratio = action["friction_threshold.omega_t"] / action["friction_threshold.v_t"]
    motions = {}
    for v_t in THRESHOLDS:
        values = {"friction_threshold.v_t": v_t, "friction_threshold.omega_t": ratio * v_t}
        motions[f"v_t {v_t:g} m/s"] = model.simulate(
            action.with_values(values), time_s, force_n, tolerance=TOLERANCE, contact_forces=True
        )
    motions["set-valued"] = limit.solution
    end = model.study.measure_blow(action, limit.solution, force_n).release_s
    rows = []
    for name, motion in motions.items():
        blow = model.study.measure_blow(action, motion, force_n)
        away = np.max(np.abs(motion.angle_rad - limit.solution.angle_rad), axis=1)
        late = (time_s >= end - CREEP_S) & (time_s <= end)
        height = motion.hammer_height_m[late]
        rows.append(
            {
                "friction": name, "strike_s": blow.strike_s, "strike_m_per_s": blow.strike_m_per_s, "held": blow.held,
                "hold_m": blow.hold_m, "creep_m_per_s": float(np.polyfit(time_s[late] - end, height, 1)[0]),
                "differs_rad": float(away.max()), "differs_until_release_rad": float(away[time_s <= end].max()),
            }
        )  # fmt: skip
    error = float(np.max(np.abs(coarse.solution.angle_rad - limit.solution.angle_rad)))
    lines = [
        f"Friction: eq. 2.10 with a falling threshold speed, and set-valued friction in steps of {1e6 * step_s:g} us",
        f"(its own error, by doubling the step: {error:.1e} rad)",
        f"{'':<14}{'strike ms':>11}{'m/s':>10}{'hold mm':>10}{'drift mm/s':>12}{'differs rad':>13}"
        f"{'until release':>15}",
    ]
    for row in rows:
        lines.append(
            f"{row['friction']:<14}{1e3 * row['strike_s']:>11.4f}{row['strike_m_per_s']:>10.5f}"
            f"{1e3 * row['hold_m']:>10.4f}{1e3 * row['creep_m_per_s']:>+12.4f}{row['differs_rad']:>13.1e}"
            f"{row['differs_until_release_rad']:>15.1e}"
        )
    return lines, {"error_rad": error, "rows": rows}
