"""Every effect and law with every job of the model: it works, or is refused in one line.

Compiles some twenty structures: ``python -m pytest -m slow tests/model/simulation/test_effects_and_jobs.py``.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import combinations
from tempfile import TemporaryDirectory

import numpy as np
import pytest

import model
from model.derived.columns import AY, CENTRE_X, CENTRE_Y, PIVOT_X, PIVOT_Y, RATED, VY
from model.derived.observe import bodies_at
from model.kernels import layout as L
from model.motion_driven.prescribed_key import rest_angle, run_prescribed
from model.parameters.action import CONTACTS
from model.parameters.effects import EFFECTS
from model.scene.key_motion import KeyMotion, angle_at_height
from model.sensitivity import find_parameters
from model.simulation.statics import solve_rest
from tests.model.batch.members import contents
from tests.model.sensitivity.richardson import changed, richardson

FORTE = model.force_table("forte")
ACTION = model.load_action("hirschkorn2004-regulated")
SOME = ("contact02", "contact04", "contact12")
PER_NEWTON = {"motor_drive": 0.1 / 1.2, "motor_arm": 0.1}  # V or N m for a newton at the tip
HAND = np.array([0.0, 0.05, 0.07, 0.09, 0.11, 0.4, 0.45, 0.7]), np.array([0.0, 0.0, 0.008, 0.022, 0.03, 0.03, 0, 0])
CASES: dict[str, tuple[model.Action, model.SceneChoice]] = {
    "whole": (ACTION, model.SceneChoice()),
    "lifting key": (ACTION, model.load_scene("lifting-key")),
    "flexible shank": (ACTION, model.load_scene("flexible-shank")),
    "giving hammer": (ACTION, model.load_scene("giving-hammer")),
    "motor arm": (ACTION, model.load_scene("motor-arm")),
    "stulov": (ACTION.with_laws(dict.fromkeys(SOME, "stulov")), model.SceneChoice()),
    "hysteresis": (ACTION.with_laws(dict.fromkeys(SOME, "hysteresis")), model.SceneChoice()),
    "hysteresis everywhere": (ACTION.with_laws(dict.fromkeys(CONTACTS, "hysteresis")), model.SceneChoice()),
    "string": (ACTION, model.SceneChoice(effects=("string",))),
    "string, rail, shank, laws": (
        ACTION.with_laws({"contact02": "stulov", "contact04": "hysteresis"}),
        model.SceneChoice(effects=("balance_rail", "shank", "string")),
    ),
    "giving joints": (ACTION, model.load_scene("giving-joints")),
    "giving joints, shank, string, laws": (
        ACTION.with_laws({"contact02": "stulov", "contact04": "hysteresis"}),
        model.SceneChoice(effects=("shank", "string", "key_pin", "jack_pin", "hammer_pin")),
    ),
    "motor arm and giving key": (ACTION, model.SceneChoice(effects=("motor_arm", "key_pin", "hammer_pin"))),
    "motor arm and string": (ACTION, model.SceneChoice(effects=("motor_arm", "string"))),
    "motor drive": (ACTION, model.SCENES["motor-drive"]),
    "motor drive by voltage": (ACTION, model.SCENES["motor-voltage"]),
    "motor drive, shank, string, law": (
        ACTION.with_laws({"contact04": "hysteresis"}),
        model.SceneChoice(effects=("motor_arm", "motor_drive", "shank", "string")),
    ),
    "finger": (ACTION, model.SCENES["finger"]),
    "finger, rail, shank, law": (
        ACTION.with_laws({"contact04": "hysteresis"}),
        model.SceneChoice(effects=("finger", "balance_rail", "shank")),
    ),
}


def _blow(choice: model.SceneChoice) -> tuple[np.ndarray, np.ndarray]:
    if "finger" in choice.effects:
        return HAND
    return FORTE[0], FORTE[1] * next((f for e, f in PER_NEWTON.items() if e in choice.effects), 1.0)


def _simulate(action: model.Action, choice: model.SceneChoice) -> None:
    found = model.simulate(action, *_blow(choice), scene=choice, contact_forces=True, energy=True, tolerance=1e-8)
    assert found.energy is not None and found.contact_normal_n is not None
    assert abs(found.energy.residual) < 1e-5 * found.energy.work_in
    assert np.all(np.isfinite(found.angle_rad)) and np.all(found.contact_normal_n >= 0.0)


def _estimate(action: model.Action, choice: model.SceneChoice) -> None:
    found = model.simulate(action, *_blow(choice), scene=choice, tolerance=1e-6, estimate_error=True)
    assert found.error_rad is not None
    assert found.error_rad < 1e-5 or found.misses_tolerance


def _batch(action: model.Action, choice: model.SceneChoice) -> None:
    """Same equations, rounded in another order, which grows where a released arm rattles: there most members say so."""
    sets = {f"{k}": {"hammer.mass": (1.0 + 0.001 * k) * action["hammer.mass"]} for k in range(17)}
    members = model.simulate_many(action, {"forte": _blow(choice)}, sets, scene=choice, lanes=True, tolerance=1e-8)
    apart = []
    for k in range(0, 17, 4):
        alone = model.simulate(action.with_values(sets[f"{k}"]), *_blow(choice), scene=choice, tolerance=1e-8)
        ours = members[k].solution
        assert ours is not None
        apart.append(np.abs(ours.angle_rad - alone.angle_rad).max())
    rattles = "motor_arm" in choice.effects and "motor_drive" not in choice.effects
    assert (np.median if rattles else np.max)(apart) < 1e-6


def _store(action: model.Action, choice: model.SceneChoice) -> None:
    """What a store gives back has every column of a run by itself, to the bit as it was computed, its error, too."""
    (times, values), at = _blow(choice), np.linspace(0.0, 0.14, 141)
    trials = {"x": (times, values), "y": (times, 0.9 * values)}
    options = {"scene": choice, "output_time_s": at, "contact_forces": True, "estimate_error": True}
    with TemporaryDirectory() as folder:
        first, again = (model.simulate_many(action, trials, lanes=True, store=folder, **options) for _ in range(2))
    assert [m.error for m in first] == [None, None] and all(m.reused for m in again)
    assert contents(first) == contents(again)
    alone, kept = model.simulate(action, *trials["y"], **options), again[1].solution
    assert kept is not None and kept.error_rad is not None and kept.error_rad > 0.0
    assert kept.columns().keys() == alone.columns().keys()
    np.testing.assert_allclose(kept.hammer_height_m(action), alone.hammer_height_m(action), atol=1e-5)


def _blocks(action: model.Action, choice: model.SceneChoice) -> None:
    """As the virtual bench goes on: block by block, held; a hand moves straight within a block."""
    scene = model.build_scene(choice.on(action), choice)
    run = model.Simulation(scene, model.State(0.0, solve_rest(scene), np.zeros(scene.size)), 1e-6)
    times, values = _blow(choice)
    for k in range(100, 130):
        if "finger" in choice.effects:
            ends = 1e-3 * np.array([k - 100, k - 99])
            run.advance(ends[1], ends, np.interp(0.04 + ends, times, values))
        else:
            run.advance(1e-3 * (k - 99), np.array([0.0]), values[5 * k : 5 * k + 1], held=True)
    assert np.all(np.isfinite(run.state.angle_rad)) and len(run.state.memory) > 0 - (not scene.remembers)


def _inside(action: model.Action, choice: model.SceneChoice) -> None:
    """What contacts and joints lose is what the audit of the same run finds, by another quadrature."""
    found = model.simulate(action, *_blow(choice), scene=choice, inside=True, energy=True, tolerance=1e-7)
    inside, audit = found.inside, found.energy
    assert inside is not None and audit is not None
    lost = [inside.rubbed_j, inside.felt_j, inside.joint_j, inside.tip_j]
    rubbed, felt, joint, tip = (float(rows[-1].sum()) for rows in lost)
    share = 2e-5 * audit.work_in
    assert rubbed == pytest.approx(audit.lost_in_contact_friction, abs=share)
    finger = audit.lost_in_drive if "finger" in choice.effects else 0.0  # its joint; a winding is no joint
    turning = audit.lost_in_joint_friction + audit.lost_in_shank + audit.lost_in_pins + finger
    assert felt + tip + joint == pytest.approx(audit.lost_in_felt + audit.lost_in_rail + turning, abs=share)
    assert "balance_rail" in choice.effects or joint == pytest.approx(turning, abs=share)


OF_EFFECT = {
    "string": "string.tension", "shank": "shank.frequency_hz", "key_pin": "key_pin.stiffness",
    "motor_arm": "motor_arm.inertia", "motor_drive": "motor_drive.torque_constant", "finger": "finger.stiffness",
}  # fmt: skip
OF_MOVED = {"motor": "motor_arm.length", "finger": "finger.length"}
STEPS_OF_MOTION = np.round(np.arange(0.0, 0.1251, 1e-3), 4)
OF_LAW = {"stulov": "epsilon", "hysteresis": "beta"}
END_S = 0.125  # after strike and rebound


def _derivatives_agree(action: model.Action, choice: model.SceneChoice, names: list[str]) -> None:
    """Derivatives of angles against Richardson's limit; of contact forces against differences."""
    blow, at = _blow(choice), np.linspace(0.0, END_S, 501)
    options = model.SensitivityOptions(
        scene=choice, tolerance=1e-10, relative_tolerance=3e-7, output_time_s=at, allow_idle=True, contact_forces=True
    )
    found = model.sensitivities(action, blow, names, options=options)
    assert found.contact_forces is not None and found.d_contact_forces is not None
    tight = {"scene": choice, "output_time_s": at, "tolerance": 1e-10 if "finger" in choice.effects else 1e-11}
    for j, parameter in enumerate(find_parameters(action, names)):
        moves = max(float(np.abs(found.d_angles[:, :, j]).max()), 1e-9)
        step = min(2e-5 / moves, 1e-2 * abs(parameter.value))  # angles move by far more than runs are off
        limit, left = richardson(action, blow, parameter.name, step, **tight)
        largest = np.max(np.abs(limit), axis=0)
        if not largest.any():
            assert parameter.name in found.idle
            continue
        counts = largest > 1e-3 * largest.max()
        apart = (np.abs(found.d_angles[:, :, j] - limit) / np.where(counts, largest, np.inf)).max(axis=1)
        assert np.quantile(apart, 0.9) < 1e-5 + left, parameter.name
        assert apart.max() < 5e-4 + 10.0 * left, parameter.name  # next to kinks
    ends = [
        model.simulate(changed(action, names[-1], s * step), *blow, contact_forces=True, **tight).contact_normal_n
        for s in (0.5, -0.5)
    ]
    assert ends[0] is not None and ends[1] is not None
    forces = found.contact_forces.shape[1]  # a tip's force stands beside those of contacts in a run
    difference = ((ends[0] - ends[1]) / step)[:, :forces]
    apart = np.abs(found.d_contact_forces[:, :, -1] - difference)
    assert np.quantile(apart, 0.99) < (1e-4 + 10.0 * left) * np.abs(difference).max()


def _printed(action: model.Action, choice: model.SceneChoice) -> model.Action:
    """The printed set with the laws of another: a regulated contact only just touches at rest, on a kink."""
    printed = model.load_action().with_laws({c: action.law(c) for c in CONTACTS})
    return choice.on(printed).with_effects({"string.modes": 12.0} if "string" in choice.effects else {})


def _sensitivities(action: model.Action, choice: model.SceneChoice) -> None:
    """By what is always there, by what effects and laws add."""
    chosen = _printed(action, choice)
    names = ["hammer.mass", "contact01"] + [name for effect, name in OF_EFFECT.items() if effect in choice.effects]
    laws = {chosen.law(c): f"{c}.{chosen.law(c)}.{OF_LAW[chosen.law(c)]}" for c in SOME if chosen.law(c) in OF_LAW}
    _derivatives_agree(chosen, choice, [*laws.values(), *names])


def _motion_of(scene: model.Scene, moved: str, at: np.ndarray, blow: tuple[np.ndarray, ...]) -> tuple[KeyMotion, ...]:
    """Motion (quintics that take over angle, speed, acceleration at ``at``) and states of a blow by force."""
    run = model.Simulation(scene, model.State(0.0, solve_rest(scene), np.zeros(scene.size)), 1e-10)
    states = run.advance(at[-1], *blow, output_time_s=at)
    times, values = blow if scene.command is None else scene.command.table(*blow, False)
    i, memory = scene.bodies.index(moved), run.remembered if scene.remembers else None
    body = bodies_at(scene.tables, scene.vector, states, memory, np.interp(at, times, values))[:, i]
    q, v, a = states[0][:, i], states[1][:, i], body[:, RATED]
    if moved == "key":  # its front as that of a key on its pivot
        x, y = front = scene.vector[scene.tables.offset[2] : scene.tables.offset[2] + 2]
        across, up = np.cos(q) * x - np.sin(q) * y, np.sin(q) * x + np.cos(q) * y
        cx, cy = body[:, CENTRE_X] - body[:, PIVOT_X], body[:, CENTRE_Y] - body[:, PIVOT_Y]
        height = up + body[:, PIVOT_Y] - scene.vector[L.GLOBALS + L.BODY_SIZE * i + L.PIVOT_Y]
        if "key_lift" in scene.bodies:
            height = up + states[0][:, scene.bodies.index("key_lift")]
        rate = body[:, VY] + v * (across - cx)
        rise = body[:, AY] + a * (across - cx) - v * v * (up - cy)
        q = angle_at_height(front, height)
        level = np.cos(q) * x - np.sin(q) * y
        v, a = rate / level, (rise + height * (rate / level) ** 2) / level
    h = np.diff(at)
    ahead = q[1:] - (q + v * np.append(h, 0.0) + 0.5 * a * np.append(h, 0.0) ** 2)[:-1]
    faster, more = v[1:] - v[:-1] - a[:-1] * h, np.diff(a)
    rows = (
        (6 * ahead - 3 * faster * h + 0.5 * more * h * h) / h**5,
        (-15 * ahead + 7 * faster * h - more * h * h) / h**4,
    )
    third = (10 * ahead - 4 * faster * h + 0.5 * more * h * h) / h**3
    return KeyMotion(at, np.column_stack([*rows, third, 0.5 * a[:-1], v[:-1], q[:-1]])), states


def _motion(action: model.Action, choice: model.SceneChoice) -> None:
    """The motion that a force made gives back that force, at the ends of its pieces and between; energies close."""
    if "string" in choice.effects:  # otherwise as many modes as a run's tolerance asks for
        action = action.with_effects({"string.modes": 30.0})
    scene, at = model.build_scene(choice.on(action), choice), np.round(np.arange(0.0, 0.14, 1e-4), 4)
    for name in ("forte", "piano"):
        hard, blow = FORTE[1].max(), _blow(choice)
        if "finger" not in choice.effects:
            blow = blow[0], np.interp(blow[0], *model.force_table(name)) * (blow[1].max() / hard)
        motion, states = _motion_of(scene, choice.moved, at, blow)
        between = np.sort(np.concatenate([at, 0.5 * (at[1:] + at[:-1])]))
        held = run_prescribed(action, motion, between, tolerance=1e-9, choice=choice, energy=True)
        wanted = np.interp(between, *blow)
        if "finger" in choice.effects:  # the hand's way, through its spring and damper
            speed = np.append(0.0, np.diff(blow[1]) / np.diff(blow[0]))[np.searchsorted(blow[0], between)]
            wanted = action["finger.stiffness"] * wanted + action["finger.damping"] * speed
        elif "winding" in scene.bodies:  # torque of the winding's current, over the arm's length
            current = np.interp(between, at, states[1][:, scene.bodies.index("winding")])
            wanted = current * action["motor_drive.torque_constant"] / held.arm_m
        elif choice.moved == "motor":
            wanted = wanted / held.arm_m
        off = np.abs(held.force_n - wanted)
        assert np.median(off) < 1e-5 and np.quantile(off, 0.95) < 1e-3, (name, np.quantile(off, [0.5, 0.9, 0.95, 0.99]))
        assert np.quantile(off, 0.99) < 0.02
        hammer = held.bodies.index("hammer"), scene.bodies.index("hammer")
        assert np.abs(held.angle_rad[::2, hammer[0]] - states[0][:, hammer[1]]).max() < 1e-5
        assert (held.give is None, held.string is None) == (not scene.pins, "string" not in choice.effects)
        assert held.energy is not None
        assert abs(held.energy.residual) < 1e-5 * held.energy.work_in


def _motion_derivatives(action: model.Action, choice: model.SceneChoice) -> None:
    """Of angles and of what holds the motion, which goes on from rest, against Richardson's limit."""
    chosen, names = _printed(action, choice), ["hammer.mass", "contact01"]
    names += [OF_MOVED[choice.moved]] if choice.moved in OF_MOVED else []
    motion, _ = _motion_of(model.build_scene(chosen, choice), choice.moved, STEPS_OF_MOTION, _blow(choice))
    turns, at = motion.raised(-rest_angle(chosen, choice)), np.linspace(0.0, 0.12, 401)
    options = model.SensitivityOptions(
        scene=choice, tolerance=1e-10, relative_tolerance=3e-7, output_time_s=at, events=False
    )
    found = model.motion_sensitivities(chosen, turns, names, options=options)

    def run(name: str, by: float) -> np.ndarray:
        other = changed(chosen, name, by)
        moved = turns.raised(rest_angle(other, choice))
        ran = run_prescribed(other, moved, at, tolerance=1e-10, choice=choice)
        order = [ran.bodies.index(body) for body in found.angle_names]
        return np.column_stack([ran.angle_rad[:, order], ran.force_n])

    assert found.d_force is not None
    for j, parameter in enumerate(find_parameters(chosen, names)):
        ours = np.column_stack([found.d_angles[:, :, j], found.d_force[:, j]])
        step = min(2e-5 / np.abs(ours[:, :-1]).max(), 1e-2 * abs(parameter.value))
        central = [(run(parameter.name, h) - run(parameter.name, -h)) / (2.0 * h) for h in (step, 0.5 * step)]
        limit = (4.0 * central[1] - central[0]) / 3.0
        largest = np.max(np.abs(limit), axis=0)
        counts = largest > 1e-3 * largest[:-1].max()
        apart = np.abs(ours - limit) / np.where(counts, largest, np.inf)
        assert np.quantile(apart[:, :-1].max(axis=1), 0.9) < 1e-5, parameter.name
        assert np.quantile(apart[:, -1], 0.9) < 2e-5, parameter.name


def _of_the_action(job: Callable[[model.Action], object]) -> Callable[[model.Action, model.SceneChoice], None]:
    def run(action: model.Action, choice: model.SceneChoice) -> None:
        assert job(action) is not None

    return run


JOBS: dict[str, Callable[[model.Action, model.SceneChoice], None]] = {
    "simulate with audit": _simulate,
    "estimated error": _estimate,
    "batch": _batch,
    "store": _store,
    "block by block": _blocks,
    "inside view": _inside,
    "sensitivities": _sensitivities,
    "prescribed motion": _motion,
    "sensitivities to a motion": _motion_derivatives,
    "touch": _of_the_action(model.touch.weigh),
    "hammer speed": _of_the_action(lambda a: model.touch.hammer_speeds(a, [5.0])),
    "null model": _of_the_action(lambda a: model.null_model.simulate(a, *FORTE)),
}


@pytest.mark.slow
@pytest.mark.parametrize("job", JOBS)
@pytest.mark.parametrize("case", CASES)
def test_every_job_takes_every_scene(case: str, job: str) -> None:
    action, choice = CASES[case]
    JOBS[job](action, choice)


LAW = "law"  # among effects: felt that remembers
PAIRS = [
    (a, b)
    for a, b in combinations((LAW, *EFFECTS), 2)
    if {a, b} not in ({"motor_arm", "finger"}, {"motor_drive", "finger"}, {"motor_arm", "motor_drive"})
]


@pytest.mark.slow
@pytest.mark.parametrize(("one", "other"), PAIRS)
def test_every_pair_of_effects_runs_with_energy_and_derivatives(one: str, other: str) -> None:
    effects = [e for e in (one, other) if e != LAW]
    if "motor_drive" in effects:
        effects.insert(0, "motor_arm")
    choice = model.SceneChoice(effects=tuple(effects))
    laws = {"contact02": "stulov", "contact04": "hysteresis"} if LAW in (one, other) else {}
    action = ACTION.with_laws(laws)
    _simulate(action, choice)
    _derivatives_agree(_printed(action, choice), choice, ["hammer.mass"])
