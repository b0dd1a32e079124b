"""Laws of felt compared with equal peak force and equal loss, so that what is left is the memory's own.

A law with memory put on a felt as it stands also presses harder and loses more or less than the law before it. Here its
share (epsilon or beta) and the height of its slow curve are fitted, in the blow itself, until the felt's largest force
and what it loses are those of the thesis's law; its second number (tau or eta) stays. Decision:
docs/explanation/felt.md.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.derived.columns import DEPTH
from model.derived.observe import contacts_at
from model.felt.laws_as_numbers import NamedLaw
from model.files.force_table import check_force_table
from model.force_driven import output_times, simulate
from model.parameters.action import BACK_CHECK, KEY_FRONT, STRING, USUAL, Action
from model.scene.build import build_scene
from model.simulation.solution import Solution
from model.study.effects import (
    NUMBERS,
    TOLERANCE,
    Blow,
    Effect,
    effect_of,
    touch_and_blow,
    varied_by_u,
    with_usual_felts,
)

Array = NDArray[np.float64]

RATE_HZ = 100_000.0  # a memory of 50 us is to be followed
SHARE, SECOND = ({law: numbers[k] for law, numbers in NUMBERS.items()} for k in (0, 1))
SHARES = {"stulov": np.linspace(0.02, 0.98, 49), "hysteresis": np.linspace(0.0125, 1.0, 80)}
ROUNDS, CLOSE = 12, 0.005  # fits, each along the press of the blow before; share of peak and loss that ends them
FELTS: Mapping[str, tuple[str, ...]] = {
    "hammer": (STRING,),
    "key front": (KEY_FRONT,),
    "back check": (BACK_CHECK,),
    "all three": (STRING, KEY_FRONT, BACK_CHECK),
}
CURVE = ("normal.a", "normal.b", "normal.c")


@dataclass(frozen=True)
class Press:
    """What a felt went through in a blow.

    Attributes
    ----------
    time_s, depth_m : (n,) where it was pressed, with a sample before and after
    peak_n, loss_j : largest force, and work it took that it did not give back
    """

    time_s: Array
    depth_m: Array
    peak_n: float
    loss_j: float


def presses(action: Action, solution: Solution, contacts: Sequence[str]) -> dict[str, Press]:
    """What felts went through in a blow that was simulated with contact forces; those never pressed are left out.

    Parameters
    ----------
    action, solution : the action and its blow
    contacts : names

    Returns
    -------
    dict of Press

    Examples
    --------
    >>> import model
    >>> action, blow = model.load_action(), model.force_table("forte")
    >>> motion = model.simulate(action, *blow, contact_forces=True)
    >>> sorted(model.study.equal_loss.presses(action, motion, ["contact02", "contact12"]))
    ['contact02', 'contact12']
    """
    scene, normal = build_scene(action), solution.contact_normal_n
    assert normal is not None
    out = {}
    for contact in (name for name in contacts if name in scene.contacts):
        c = scene.contacts.index(contact)
        near = np.flatnonzero(np.convolve(normal[:, c] > 0.0, np.ones(3), "same") > 0.0)
        states = solution.angle_rad[near], solution.speed_rad_per_s[near]
        depth = contacts_at(scene.static_tables, scene.vector, *states)[:, c, DEPTH]
        force = normal[near, c]
        if len(near) > 2 and force.max() > 0.0:
            moved = np.diff(np.maximum(depth, 0.0))
            loss = float(np.sum(0.5 * (force[1:] + force[:-1]) * moved))
            out[contact] = Press(solution.time_s[near], depth, float(force.max()), loss)
    return out


def effects_at_equal_loss(
    action: Action, time_s: ArrayLike, force_n: ArrayLike, felts: Mapping[str, Sequence[str]] = FELTS
) -> list[Effect]:
    """Change the law of some felts, each with the peak force and the loss that the thesis's law has in this blow.

    Parameters
    ----------
    action : parameter set; its own laws and scene are set aside
    time_s, force_n : (k,) force table
    felts : name of a group -> its contacts; none of them pressed at rest

    Returns
    -------
    list of Effect
        The thesis's law first. ``peak_n`` and ``loss_mj`` of the first felt of the group say how equal they are, beside
        the fitted ``share`` and ``height``; uncertain by u of tau or eta, everything fitted again.

    Raises
    ------
    InputError : a felt that a law with memory cannot have
    StaticsError, IntegrationError : the action cannot play this blow

    Examples
    --------
    >>> import model
    >>> blow = model.force_table("forte")
    >>> base, *others = model.study.effects_at_equal_loss(
    ...     model.load_action("hirschkorn2004-regulated"), *blow, {"hammer": ["contact12"]})
    >>> all(abs(e.value["loss_mj"] / base.value["loss_mj"] - 1.0) < 0.02 for e in others)
    True
    """
    plain = with_usual_felts(action)
    blow = check_force_table(time_s, force_n)
    out = []
    for name, contacts in felts.items():
        wanted = presses(plain, _blow(plain, blow), contacts)
        found = [c for c in contacts if c in wanted]
        if not found:
            continue

        def marks(variant: Action, seen: Sequence[str] = found) -> dict[str, float]:
            press = presses(variant, _blow(variant, blow), seen[:1]).get(seen[0])
            own = {"peak_n": press.peak_n, "loss_mj": 1e3 * press.loss_j} if press else {}
            law = variant.law(seen[0])
            share = math.nan if law == USUAL else variant[f"{seen[0]}.{SHARE[law]}"]
            height = variant[f"{seen[0]}.normal.c"] / plain[f"{seen[0]}.normal.c"]
            return touch_and_blow(variant, blow) | own | {"share": share, "height": height}

        out.append(effect_of(name, USUAL, [plain], marks))
        for law, second in SECOND.items():
            given = plain.with_laws(dict.fromkeys(found, law))
            every = [given, *varied_by_u(given, [[f"{c}.{second}" for c in found]])]
            out.append(effect_of(name, law, [_fitted(plain, one, law, wanted, blow) for one in every], marks))
    return out


def _blow(action: Action, blow: Blow) -> Solution:
    times, forces = blow
    at = output_times(float(times[0]), float(times[-1]), RATE_HZ)
    return simulate(action, times, forces, tolerance=TOLERANCE, output_time_s=at, contact_forces=True)


def _fitted(plain: Action, given: Action, law: str, wanted: Mapping[str, Press], blow: Blow) -> Action:
    """The action whose felts have the peak force and the loss that are wanted: fitted along the last blow's press."""
    along = dict(wanted)
    best, least = given, math.inf
    for _ in range(ROUNDS):
        for contact, press in along.items():
            aim = replace(wanted[contact], time_s=press.time_s, depth_m=press.depth_m)
            values = _fit(plain, given, contact, law, aim)
            given = given.with_values({p: x for p, x in values.items() if p in given.quantities})
            given = given.with_effects({p: x for p, x in values.items() if p in given.effects})
        along = presses(given, _blow(given, blow), tuple(wanted))
        if set(along) != set(wanted):
            break
        off = max(
            max(abs(along[c].peak_n / wanted[c].peak_n - 1.0), abs(along[c].loss_j / wanted[c].loss_j - 1.0))
            for c in wanted
        )
        if off < least:
            best, least = given, off
        if off < CLOSE:
            break
    return best


def _fit(plain: Action, given: Action, contact: str, law: str, wanted: Press) -> dict[str, float]:
    """Share and height of the curve with which the law has the wanted peak and loss along one press.

    Force is in proportion to the height, so that loss over peak belongs to the share alone.
    """
    a, b, c = (plain[f"{contact}.{k}"] for k in CURVE)
    second = given[f"{contact}.{SECOND[law]}"]
    moved = np.diff(np.maximum(wanted.depth_m, 0.0))
    felts = [_felt(law, (a, b, c), float(share), second) for share in SHARES[law]]
    forces = np.array([felt.response(wanted.time_s, wanted.depth_m).force_n for felt in felts])
    peaks = np.maximum(forces.max(axis=1), 1e-12)
    off = 0.5 * (forces[:, 1:] + forces[:, :-1]) @ moved / peaks - wanted.loss_j / wanted.peak_n
    crossing = np.flatnonzero(off[:-1] * off[1:] <= 0.0)
    if len(crossing):
        k = int(crossing[0])
        part = 0.0 if off[k] == off[k + 1] else off[k] / (off[k] - off[k + 1])
        share = float(SHARES[law][k] + part * (SHARES[law][k + 1] - SHARES[law][k]))
        peak = peaks[k] + part * (peaks[k + 1] - peaks[k])
    else:  # as near as the law gets
        k = int(np.argmin(np.abs(off)))
        share, peak = float(SHARES[law][k]), peaks[k]
    height = wanted.peak_n / peak
    values = {f"{contact}.{k}": height * x for k, x in zip(CURVE, (a, b, c), strict=True)}
    return values | {f"{contact}.{SHARE[law]}": share}


def _felt(law: str, curve: tuple[float, float, float], share: float, second: float) -> NamedLaw:
    values = {SHARE[law].removeprefix(f"{law}."): share, SECOND[law].removeprefix(f"{law}."): second}
    return NamedLaw(law, *curve, values=values)
