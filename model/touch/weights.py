"""Down, up, balance and friction weight and let-off peak of an action, from a slow press and release.

Forces in N at the key front, dips in m. The key goes down to first touch of its felt and comes back, with all friction.
Weights are means over the middle of the dip, where a technician's weights move the key.

They are those of the limit without inertia: at 5 mm/s light friction lets hammer and jack swing, and no mean of that
force is a weight. So the key moves `SLOWER` times as fast, and the threshold speeds of friction are lowered as much:
friction then is what it is at 5 mm/s, what inertia and damping add falls with the speed. A second press at twice that
speed says what is left of it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from model.errors import InputError, StaticsError
from model.motion_driven.prescribed_key import key_load
from model.motion_driven.slow_press import SLOW_M_PER_S, Press, key_angle_at_dip, slow_press
from model.parameters.action import BACK_CHECK, BODIES, KEY_FRONT, STRING, Action, ActionLike, as_action
from model.regulation.measures import SLIPPED, measure_at_rest
from model.scene.build import build_scene
from model.scene.key_motion import KeyMotion, append_prescribed_motion
from model.scene.selection import choice_of
from model.simulation.hand_set_rest import hand_set_rest, slip_angle
from model.simulation.statics import solve_rest

Array = NDArray[np.float64]

SLOWER = (0.1, 0.05)  # of that speed: let-off peaks at 0.05 are within 0.2 % of those at 0.02
MIDDLE = (0.25, 0.60)  # of the dip: the jack carries the hammer and does not touch the button yet
SMOOTH = 1e-4  # m of dip over which a force is averaged before its peak is read
BATCHES = 10  # of the middle, whose means say how far the force's own mean is uncertain
STATIC_DIPS = 13  # places in the middle where the balance is solved for
SMALLEST_DIP_M = 1e-4  # a key that cannot be pressed further has no touch
STEADY_N = 0.01  # a technician's weights go in steps of 1 g: what is not known to that is not steady
JAMMED, JAMMED_N = 0.1, 0.05  # of the force on the key, and N: what a contact without a part in let-off may press
NO_LET_OFF = (KEY_FRONT, BACK_CHECK, STRING)  # contacts that have no part in it
BESIDE_N = 1e-3  # difference of balance from which on the release is said to go another way; a tenth of a gram


@dataclass(frozen=True)
class Weights:
    """Forces in N at the key front, the depth of the dip, and the press that they were read from.

    Attributes
    ----------
    down_n, up_n : force that moves the key down, and that lets it up, with the hammer on the jack
    balance_n : force that balances the key without friction, by virtual work
    friction_n : half the difference of down and up weight
    let_off_n : largest force before the jack lets go; NaN where it does not
    u_down_n, u_up_n, u_balance_n, u_friction_n, u_let_off_n : standard uncertainty of the computation, not of the
        parameters
    dip_m : of the key
    press : the slower of the two presses
    remarks : what is not steady, jams or cannot be weighed, a sentence each
    """

    down_n: float
    up_n: float
    balance_n: float
    friction_n: float
    let_off_n: float
    u_down_n: float
    u_up_n: float
    u_balance_n: float
    u_friction_n: float
    u_let_off_n: float
    dip_m: float
    press: Press
    remarks: tuple[str, ...] = ()

    def rows(self) -> dict[str, tuple[float, float]]:
        """Each weight and its standard uncertainty, N, by name."""
        return {
            "down weight": (self.down_n, self.u_down_n),
            "up weight": (self.up_n, self.u_up_n),
            "balance weight": (self.balance_n, self.u_balance_n),
            "friction weight": (self.friction_n, self.u_friction_n),
            "let-off peak": (self.let_off_n, self.u_let_off_n),
        }

    def curve(self) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
        """Dip (m) and force (N), averaged over `SMOOTH`, as a pair for the press, then for the release, while the key
        moves."""
        branches = []
        force, press = _smoothed_force(self.press), self.press
        moving = np.gradient(press.dip_m, press.time_s)
        cruise = float(np.max(np.abs(moving)))
        for leg, sign in ((0, 1.0), (1, -1.0)):
            on = (press.leg == leg) & (sign * moving > 0.5 * cruise)
            branches.append((press.dip_m[on], force[on]))
        return branches[0], branches[1]


def _window_samples(press: Press) -> int:
    return max(1, round(SMOOTH / float(np.max(np.abs(np.diff(press.dip_m))))))


def _smoothed_force(press: Press) -> Array:
    """Force (m,) averaged over the samples in which the key moves by `SMOOTH`."""
    width = _window_samples(press)
    padded = np.pad(press.force_n, (width // 2, width - 1 - width // 2), mode="edge")
    return np.asarray(np.convolve(padded, np.full(width, 1.0 / width), mode="valid"))


def _find_jams(press: Press) -> NDArray[np.bool_]:
    """Samples (m,) at which a contact without a part in let-off presses noticeably."""
    normal = [press.contact_normal_n[c] for c in NO_LET_OFF if c in press.contact_normal_n]
    if not normal:
        return np.zeros(len(press.time_s), dtype=bool)
    return np.asarray(np.max(normal, axis=0) > JAMMED * np.abs(_smoothed_force(press)) + JAMMED_N)


def _describe_jam(action: Action, press: Press, at: NDArray[np.int64]) -> str:
    """Sentence on the hardest jam among the samples ``at`` (indexes): contact, force and dip."""
    force = _smoothed_force(press)
    worst = int(at[np.argmax(force[at])])
    contacts = {c: float(press.contact_normal_n[c][worst]) for c in NO_LET_OFF if c in press.contact_normal_n}
    contact = max(contacts, key=lambda c: contacts[c])
    words = action.structure.get(f"{contact}.description", "contact")
    return (
        f"{words} ({contact}) presses with {contacts[contact]:.3g} N at {1e3 * press.dip_m[worst]:.2f} mm of dip, "
        f"{force[worst]:.3g} N on the key"
    )


def _simulate_press(action: Action, rest: Array, dip_m: float, slower: float) -> Press:
    """A press and release at a share of the speed, friction as at the whole of it."""
    thresholds = ("friction_threshold.v_t", "friction_threshold.omega_t")
    slowed = action.with_values({path: slower * action[path] for path in thresholds})
    return slow_press(slowed, rest, [dip_m, 0.0], speed_m_per_s=slower * SLOW_M_PER_S)


def _mid_dip_samples(press: Press, dip_m: float, leg: int) -> NDArray[np.int64]:
    inside = (press.dip_m > MIDDLE[0] * dip_m) & (press.dip_m < MIDDLE[1] * dip_m)
    return np.flatnonzero(inside & (press.leg == leg))


def _mean_force(press: Press, at: NDArray[np.int64]) -> tuple[float, float]:
    """Mean force over the dip at the samples ``at`` (indexes), N, and its standard uncertainty, N.

    The uncertainty is by batch means of the residuals of a parabola.
    """
    dip, force = press.dip_m[at], press.force_n[at]
    x = (dip - dip.mean()) / max(float(np.ptp(dip)), 1e-12)
    left = force - np.polynomial.Polynomial.fit(x, force, 2)(x)
    means = [float(batch.mean()) for batch in np.array_split(left, BATCHES)]
    mean = float(np.trapezoid(force, dip) / (dip[-1] - dip[0]))
    return mean, float(np.std(means, ddof=1)) / math.sqrt(BATCHES)


def _static_force(action: Action, rest: Array, press: Press, at: NDArray[np.int64]) -> tuple[float, float]:
    """Mean force that holds the key at the dips of samples ``at`` (indexes) of a press, and its uncertainty, both N.

    It is the static force on the key's front without friction, against gravity, springs and felt, solved for at
    `STATIC_DIPS` of the samples and averaged over the dip. The standard uncertainty is the change by half as many.
    """
    chosen = at[np.linspace(0, len(at) - 1, STATIC_DIPS).round().astype(int)]
    dips = press.dip_m[chosen]
    angles = np.array([key_angle_at_dip(action, rest, dip) for dip in dips.tolist()])
    turn = float(angles[-1] - angles[0])
    motion = KeyMotion(np.array([0.0, 1.0]), np.array([[0.0, 0.0, 0.0, 0.0, turn, float(angles[0])]]))
    scene = build_scene(action, key_motion=motion)
    still, forces = replace(scene, tables=scene.static_tables), list[float]()
    for k, angle in zip(chosen.tolist(), angles.tolist(), strict=True):
        own = scene.start.copy()
        for i, body in enumerate(scene.bodies[: scene.size]):
            own[i] = press.angle_rad[k, BODIES.index(body)] if body in BODIES else own[i]
        found = solve_rest(scene, (angle - float(angles[0])) / turn, own, with_joints=True)
        memory = np.concatenate([found[scene.size :], np.zeros(len(scene.pins))])[None]
        q, moved = found[None, : scene.size], np.array([[angle, 0.0]])
        whole, speeds = append_prescribed_motion(still.tables, still.vector, (q, np.zeros_like(q)), moved, memory)
        forces.append(float(key_load(still, whole, speeds, np.zeros(1), memory=memory)[0][0]))
    fine, coarse = (float(np.trapezoid(forces[::k], dips[::k]) / (dips[-1] - dips[0])) for k in (1, 2))
    return fine, abs(fine - coarse)


def _find_let_off(action: Action, press: Press, dip_m: float) -> tuple[float, tuple[str, ...]]:
    """Largest averaged force, N, from 0.6 of the dip on until the jack lets go or something jams, NaN where there is
    none; and remarks, sentences on what was not weighed.

    What another contact jams is named, not weighed. Averages end before the jack lets go: what follows is a fall.
    """
    way = np.flatnonzero((press.leg == 0) & (press.dip_m >= MIDDLE[1] * dip_m))
    slipped = np.flatnonzero(slip_angle(action, press.angle_rad[way]) > SLIPPED)
    jams, width = np.flatnonzero(_find_jams(press)[way]), _window_samples(press)
    end = min(slipped[0] if len(slipped) else 0, jams[0] if len(jams) else len(way))
    peak, remarks = math.nan, list[str]()
    if end >= width:
        peak = float(np.convolve(press.force_n[way[:end]], np.full(width, 1.0 / width), mode="valid").max())
    elif not len(slipped):
        remarks.append("let-off peak: the jack does not let go before the key is down")
    else:
        remarks.append("let-off peak: none, the jack has let go or something jams before it")
    if len(jams) and not _smoothed_force(press)[way[jams]].max() <= peak:
        remarks.append(f"jam: {_describe_jam(action, press, way[jams])}; not weighed as let-off")
    return peak, tuple(remarks)


def weigh(action: ActionLike) -> Weights:
    """Down, up, balance and friction weight and let-off peak, N at the key front, with uncertainties, from a slow press
    to first touch of the key's felt and its release; NaN with a remark where something jams.

    Parameters
    ----------
    action : parameter set

    Returns
    -------
    Weights
        Down, up, balance and friction weight and let-off peak, N, with their uncertainties, and the press itself.

    Raises
    ------
    InputError : the key has no dip; or the scene lacks a body or is not driven by a force
    StaticsError, IntegrationError : the action has no rest state or cannot be pressed

    Examples
    --------
    >>> import model
    >>> weights = model.touch.weigh(model.load_action("hirschkorn2004"))
    >>> print(f"{weights.down_n:.2f} N down, {weights.balance_n:.3f} N in balance")
    0.45 N down, 0.306 N in balance
    """
    action = as_action(action)
    choice_of(action).need_played_key(action.name)
    rest = hand_set_rest(action)
    dip = measure_at_rest(action, rest)["dip"]
    if not dip > SMALLEST_DIP_M:
        raise InputError(
            f"{action.origin}: key dip found {1e3 * dip:.2f} mm, allowed above {1e3 * SMALLEST_DIP_M:g}; "
            "lower contact02.first.y"
        )
    faster, press = (_simulate_press(action, rest, dip, share) for share in SLOWER)
    jammed, values, u, remarks = _find_jams(press), list[float](), list[float](), list[str]()
    balances = [(math.nan, math.nan)] * 2
    for leg, name in enumerate(("down weight", "up weight")):
        at = _mid_dip_samples(press, dip, leg)
        if jammed[at].any():
            values, u = [*values, math.nan], [*u, math.nan]
            remarks.append(f"{name}: jam, {_describe_jam(action, press, at[jammed[at]])}; not weighed")
            continue
        mean, scatter = _mean_force(press, at)
        values.append(mean)
        u.append(math.hypot(scatter, mean - _mean_force(faster, _mid_dip_samples(faster, dip, leg))[0]))
        if 2.0 * u[-1] > STEADY_N:
            remarks.append(f"{name}: not steady, the press oscillates; u {u[-1]:.3f} N")
        try:
            balances[leg] = _static_force(action, rest, press, at)
        except StaticsError:
            remarks.append(f"{name}: nothing rests there without friction, no balance")
    (down, up), (balance, u_balance), (returning, _) = values, *balances
    if abs(returning - balance) > BESIDE_N:
        remarks.append(
            f"up weight: on the way up the key balances at {returning:.3f} N, not at {balance:.3f} N as on the way "
            "down, for the jack is not back under the knuckle; the difference is taken off"
        )
    up -= 0.0 if math.isnan(returning - balance) else returning - balance
    let_off, others = _find_let_off(action, press, dip)
    return Weights(
        down_n=down,
        up_n=up,
        balance_n=balance,
        friction_n=0.5 * (down - up),
        let_off_n=let_off,
        u_down_n=u[0],
        u_up_n=u[1],
        u_balance_n=u_balance,
        u_friction_n=0.5 * math.hypot(*u),
        u_let_off_n=abs(let_off - _find_let_off(action, faster, dip)[0]),
        dip_m=dip,
        press=press,
        remarks=(*remarks, *others),
    )
