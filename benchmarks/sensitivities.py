"""Error against time of derivatives of a blow: integrated beside it, or by differences of runs.

Errors are those of the angles' derivatives over a forte of 0.7 s, of each angle's largest derivative, the worst of all
angles and parameters, against Richardson's limit of central differences of runs at 1e-11 rad. Times are processor time
in runs of `simulate` at its default tolerance; those of 60 columns are measured, differences of 60 columns are taken as
so many runs. The worst of all 60 columns is against the same derivatives at 1e-12 rad, relative 1e-8, of each angle's
largest derivative or of 1e-4 rad per change of the parameter by all of its value, below which no step is decided
(`--tangents`: these rows alone). Then the same columns with events and contact forces at all times: forces' errors are
of each force's largest derivative, or of 1e-3 of its largest value per such change, away from kinks (no contact begins
or ceases to push within a sample) and anywhere; events' of their derivatives, or of 1e-4 of the largest of one by any
parameter per such change.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

import model
from benchmarks.runner import Run, Table, in_turns, least, may_be
from model.sensitivity import find_parameters

Array = NDArray[np.float64]

# with a step of converged differences, in the parameter's unit
STEPS = {
    "hammer.mass": 1e-6, "key.inertia": 1e-7, "contact02": 1e-4, "contact01.friction.A": 1e-5, "friction": 3e-5,
    "hammer.joint_friction.A": 1e-6, "contact12.normal.D": 1e-5, "contact07.second.x": 2e-7, "hammer.pivot.x": 1e-7,
}  # fmt: skip
SETTINGS = ((1e-9, 1e-6), (2e-9, 3e-6), (2e-9, 1e-5), (1e-8, 1e-5), (1e-7, 1e-4), (1e-6, 1e-3))
DEFAULT = model.SensitivityOptions.tolerance, model.SensitivityOptions.relative_tolerance
RIGHT = 1e-5
REFERENCE = model.SensitivityOptions(tolerance=1e-12, relative_tolerance=1e-8, events=False, allow_idle=True)
ALL = replace(REFERENCE, events=True, contact_forces=True)
SHARES = (1e-6, 1e-5, 1e-4, 1e-3)  # of the step of a difference, of the parameter's value


def sixty(action: model.Action) -> list[str]:
    """Felts, frictions, dampings, masses, inertias, springs, geometry, all at work in a forte."""
    names = [f"contact{i:02d}" for i in range(1, 14)]
    names += [f"contact{i:02d}.friction.A" for i in (1, 2, 4, 7, 9, 10)]
    names += [f"contact{i:02d}.normal.D" for i in range(1, 13)]
    names += [f"{body}.{k}" for body in model.BODIES for k in ("mass", "inertia", "joint_friction.A")]
    names += ["jack_spring.torque", "repetition_spring.stiffness", "hammer.pivot.x", "hammer.pivot.y", "key.pivot.y"]
    names += ["contact07.second.x", "contact01.first.y", "contact02.second.y", "contact12.first.radius"]
    names += ["contact04.second.y", "contact08.first.y", "contact11.first.y", "gravity.g", "friction_threshold.v_t"]
    assert all(find_parameters(action, names))
    return names


def far(found: Array, truth: Array) -> float:
    """Largest difference of any angle's derivative (m, n), of that angle's largest."""
    return float(np.max(np.max(np.abs(found - truth), axis=0) / np.max(np.abs(truth), axis=0)))


def each(errors: list[float]) -> str:
    """Errors of parameters, one after the other."""
    return " ".join(f"{e:.0e}" for e in errors)


def off(found: Array, limit: Array, smallest: Array) -> Array:
    """Differences of derivatives (m, c, P) from their limit, of their largest values, or of ``smallest``, (c, P)."""
    return np.asarray(np.abs(found - limit) / np.maximum(np.max(np.abs(limit), axis=0), smallest))


def worst(found: model.Sensitivities, limit: model.Sensitivities, scale: Array) -> tuple[float, Array, float]:
    """Errors of derivatives of angles, the worst, of contact forces that act (m, c, P), and of events, the worst.

    ``scale`` (P,) is a change of each parameter by all of its value.
    """
    forces, events = np.zeros((1, 1, 1)), [0.0]
    if found.d_contact_forces is not None:
        most = np.max(limit.contact_forces, axis=0)
        act = most > 0.0
        forces = off(found.d_contact_forces[:, act], limit.d_contact_forces[:, act], 1e-3 * most[act, None] / scale)
    for name in found.d_events:
        d = limit.d_events[name]
        if np.all(np.isfinite(d)):
            size = np.maximum(np.abs(d), 1e-4 * np.max(np.abs(d * scale)) / scale)
            events.append(float(np.max(np.abs(found.d_events[name] - d) / size)))
    return float(np.max(off(found.d_angles, limit.d_angles, 1e-4 / scale))), forces, max(events)


def scales(action: model.Action, names: Sequence[str]) -> Array:
    """A change of each parameter by all of its value."""
    return np.array([parameter.scale for parameter in find_parameters(action, names)])


def all_asked(action: model.Action, blow: tuple[Array, Array], limit: model.Sensitivities, run: float) -> None:
    """Print the rows with events and contact forces, at the default tolerances."""
    names = limit.parameters
    jumps = np.any(np.diff(limit.contact_forces > 0.0, axis=0), axis=1)  # type: ignore[operator]
    near = np.convolve(np.append(False, jumps) | np.append(jumps, False), np.ones(3), "same") > 0.0
    for events, forces in ((True, False), (False, True), (True, True)):
        options = model.SensitivityOptions(events=events, contact_forces=forces, allow_idle=True)
        _, apart, at_events = worst(
            model.sensitivities(action, blow, names, options=options), limit, scales(action, names)
        )
        spent = least(lambda o=options: model.sensitivities(action, blow, names, options=o), 5)
        words = ["60 columns", *["events"] * events, *["contact forces"] * forces]
        line = f"{', '.join(words):<52} {spent / run:>6.1f}"
        line += f"  forces {np.max(apart[~near]):.1e} ({np.max(apart):.1e} anywhere)" if forces else ""
        print(line + (f"  events {at_events:.1e}" if events else ""))


def tangents(
    action: model.Action, blow: tuple[Array, Array], names: list[str], truth: dict[str, Array]
) -> tuple[float, float]:
    """Print the rows of derivatives integrated beside the motion; the time of a run, s, and the default's error."""
    run = least(lambda: model.simulate(action, *blow), 9)
    print(f"a run at 1e-5 rad: {1e3 * run:.1f} ms")
    print(f"{'60 columns':<52} {'runs':>6} {'own runs':>9} {'worst error':>12}  worst of 60 columns, per parameter")
    limit = model.sensitivities(action, blow, names, options=ALL)
    default = np.inf
    for tolerance, relative in SETTINGS:
        options = replace(REFERENCE, tolerance=tolerance, relative_tolerance=relative)
        of_all = worst(model.sensitivities(action, blow, names, options=options), limit, scales(action, names))[0]
        if (tolerance, relative) == DEFAULT:
            default = of_all
        errors = [0.0]
        if truth:
            known = model.sensitivities(action, blow, [*truth], options=options).d_angles
            errors = [far(known[:, :, j], truth[name]) for j, name in enumerate(truth)]
        spent = least(lambda o=options: model.sensitivities(action, blow, names, options=o))
        own = least(lambda t=tolerance: model.simulate(action, *blow, tolerance=t, method="rodas5p"))
        words = f"tangents, tolerance {tolerance:g} rad, relative {relative:g}"
        print(f"{words:<52} {spent / run:>6.1f} {spent / own:>9.1f} {max(errors):>12.1e}  {of_all:.1e}, {each(errors)}")
    all_asked(action, blow, limit, run)
    return run, default


def scenes(only: list[str]) -> None:
    """Print what a blow and what derivatives cost in each scene, times those of the whole action without effects.

    Times are processor time, all scenes in turns.
    """
    action = model.load_action()
    some = ("contact01", "contact02", "contact12")
    thirty = action.with_effects({"string.modes": 30.0})
    cases = {"whole": (action, model.SceneChoice())}
    cases |= {
        law: (action.with_laws(dict.fromkeys(some, law)), model.SceneChoice()) for law in ("stulov", "hysteresis")
    }
    cases |= {"string of 30 modes": (thirty, model.SceneChoice(effects=("string",)))}
    named = ("string", "without-string", "lifting-key", "flexible-shank", "giving-hammer", "giving-joints")
    cases |= {name: (action, model.load_scene(name)) for name in (*named, "motor-arm", "motor-drive")}
    per = {"motor_drive": 0.1 / 1.2, "motor_arm": 0.1}
    time_s, force = model.force_table("forte")
    runs: dict[str, Any] = {}
    derivatives: dict[str, Any] = {}
    everything: dict[str, Any] = {}
    sides = dict[str, float]()
    for name, (chosen, choice) in cases.items():
        if only and name not in (*only, "whole"):
            continue
        driven = time_s, force * next((x for effect, x in per.items() if effect in choice.effects), 1.0)
        columns = [x for x in sixty(chosen) if not (x.endswith(".normal.D") and name in ("stulov", "hysteresis"))]
        if "contact12" in choice.without:
            columns = [x for x in columns if not x.startswith("contact12")]
        runs[name] = partial(model.simulate, chosen, *driven, scene=choice)
        for jobs, asked in ((derivatives, False), (everything, True)):
            options = model.SensitivityOptions(scene=choice, allow_idle=True, events=asked, contact_forces=asked)
            jobs[name] = partial(model.sensitivities, chosen, driven, columns, options=options)
        sides[name] = runs[name]().counters["n_rhs"]
    spent = [in_turns(jobs, turns) for jobs, turns in ((runs, 9), (derivatives, 3), (everything, 3))]
    blow, alone, all_ = ({name: float(t.min()) for name, t in jobs.items()} for jobs in spent)
    heads = ["ms a blow:.1f", "times whole:.2f", "right-hand sides, times whole:.2f"]
    for words in ("60 columns", "with events, forces"):
        heads += [f"{words}, times whole:.2f", "in blows:.1f"]
    table = Table("scene:<19s", *heads)
    for name in runs:
        price = [1e3 * blow[name], blow[name] / blow["whole"], sides[name] / sides["whole"]]
        for of in (alone, all_):
            price += [of[name] / of["whole"], of[name] / blow[name]]
        table.row(name, *price)


def main(run: Run) -> bool:
    """Print the table; whether derivatives are right to 1e-5 at the default tolerances."""
    if run.scenes:
        scenes(run.only)
        return True
    action, blow = model.load_action(), model.force_table("forte")
    names = sixty(action)[: run.columns]
    if run.tangents:
        return tangents(action, blow, names, {})[1] <= RIGHT

    def central(name: str, step: float, tolerance: float) -> Array:
        (parameter,) = find_parameters(action, [name])
        high, low = (
            model.simulate(
                action.with_values({path: action[path] + sign * step * w for path, w in parameter.paths.items()}),
                *blow, tolerance=tolerance, method="rodas5p",
            ).angle_rad
            for sign in (1.0, -1.0)
        )  # fmt: skip
        return (high - low) / (2.0 * step)

    truth = {name: (4.0 * central(name, 0.5 * h, 1e-11) - central(name, h, 1e-11)) / 3.0 for name, h in STEPS.items()}
    run_s, of_all = tangents(action, blow, names, truth)
    for tolerance in (1e-9, 1e-7, 1e-5):
        own = least(lambda t=tolerance: model.simulate(action, *blow, tolerance=t, method="rodas5p"))
        errors = []
        for name in STEPS:
            (parameter,) = find_parameters(action, [name])
            errors.append(min(far(central(name, s * parameter.scale, tolerance), truth[name]) for s in SHARES))
        words = f"central differences of runs at {tolerance:g}, best of four steps"
        print(f"{words:<52} {120 * own / run_s:>6.1f} {120.0:>9.1f} {max(errors):>12.1e}  {each(errors)}")
    return of_all <= RIGHT


def random_blow(random: np.random.Generator) -> tuple[str, tuple[Array, Array]]:
    """A force on the key, and what it is."""
    kind = ("half sine", "slow ramp", "repeated", "two steps", "triangle")[int(random.integers(5))]
    end = float(random.uniform(0.25, 0.45))
    time = np.linspace(0.0, end, int(5000 * end) + 1)
    top, width = float(random.uniform(3.0, 20.0)), float(random.uniform(0.06, 0.15))

    def half_sine(start: float) -> Array:
        return np.asarray(np.sin(np.pi * np.clip((time - start) / width, 0.0, 1.0)))

    if kind == "slow ramp":
        return kind, (time, top * np.clip(time / float(random.uniform(0.15, 0.3)), 0.0, 1.0))
    if kind == "two steps":
        low = top / 3.0
        return kind, (time, np.interp(time, [0.0, 0.01, 0.06, 0.07, 0.2, 0.21], [0.0, low, low, top, top, top / 4.0]))
    if kind == "triangle":
        return kind, (time, np.interp(time, [0.0, width, 2.0 * width], [0.0, top, 0.0]))
    return kind, (time, top * (half_sine(0.0) + (half_sine(1.4 * width) if kind == "repeated" else 0.0)))


def random_set(random: np.random.Generator) -> model.Action:
    """One of the two built-in actions, changed."""
    action = model.load_action("hirschkorn2004" if random.random() < 0.6 else "hirschkorn2004-regulated")
    changed = {}
    for path, q in action.quantities.items():
        number = q.unit not in ("m", "rad") and "second.normal" not in path and q.value > 0.0
        if number and random.random() < 0.5:
            changed[path] = q.value * float(np.exp(random.normal(0.0, 0.15)))
        elif q.unit == "m" and "pivot" in path and random.random() < 0.3:
            changed[path] = q.value + float(random.normal(0.0, 1e-4))
    return action.with_values(changed)


def errors(action: model.Action, blow: tuple[Array, Array], scene: str) -> tuple[float, float, float, float]:
    """Worst errors of angles, of contact forces, their quantile 0.9999, and of events."""
    names, tight = sixty(action), replace(ALL, scene=scene)
    usual = replace(tight, tolerance=DEFAULT[0], relative_tolerance=DEFAULT[1])
    limit, found = (model.sensitivities(action, blow, names, options=options) for options in (tight, usual))
    if found.absent_events != limit.absent_events:
        print(f"  other events happen: {found.absent_events} {limit.absent_events}")
    angles, forces, events = worst(found, limit, scales(action, names))
    return angles, float(np.max(forces)), float(np.quantile(forces, 0.9999)), events


def sensitivities_random(run: Run) -> bool:
    """Derivatives at the default tolerances on random parameter sets and forces, against tight ones (1e-12 rad, 1e-8).

    A set has half of its laws and masses changed by some 15 %, a third of its pivots by 0.1 mm; forces are half sines,
    slow ramps, repeated blows, steps and triangles of 3 to 20 N. Errors are those of the worst of 60 columns, as in
    `sensitivities.py`; of contact forces also the quantile 0.9999, which leaves out the samples next to a kink.
    """

    def case(seed: int, scene: str) -> dict[str, Any]:
        random = np.random.default_rng(seed)
        action = random_set(random)
        kind, blow = random_blow(random)
        try:
            return {"kind": kind, "errors": errors(action, blow, scene)}
        except model.ModelError as error:
            return {"kind": f"{kind}: refused, {error}"}

    rows = []
    table = Table("force:10s", "seed:d", "angles:.1e", "forces:.1e", "0.9999:.1e", "events:.1e")
    for (seed, _), row in run.cases([(run.seed + k, run.scene) for k in range(run.sets)], case):
        rows += [row["errors"]] if "errors" in row else []
        table.row(row["kind"], seed, *row.get("errors", [None] * 4))
    for word, of in (("median", np.median(rows, axis=0)), ("largest", np.max(rows, axis=0))):
        table.row(word, None, *of)
    middle, most = np.median(rows, axis=0), np.max(rows, axis=0)
    run.figure("derivatives-random", " / ".join(f"{middle[k]:.1e} and {most[k]:.1e}" for k in (0, 2, 3)))
    near = sum(row[0] <= 1e-5 for row in rows)
    print(f"angles within 1e-5: {near} of {len(rows)}")
    return may_be(0.5, near, len(rows))
