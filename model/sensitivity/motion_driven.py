"""Derivatives where a measured motion drives the action: the function `model.motion_sensitivities`.

An encoder tells changes since rest, so the angle is the rest angle plus what was measured: the whole motion moves with
the rest angle, whose derivative enters as that of the prescribed coordinate. Of a key that lifts or whose joint gives
that is the angle of its front (`model.scene.key_motion`); its true angle follows from how far it has risen.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.errors import InputError
from model.force_driven import check_output_times
from model.motion_driven.prescribed_key import LONGEST_STEP_S, key_load, prescribed_angle
from model.motion_driven.spline_fit import fit_key_motion
from model.parameters.action import ActionLike, as_action, load_action
from model.parameters.effects import ARM, FINGER, MOTOR
from model.scene.build import build_scene
from model.scene.key_motion import KeyMotion, append_prescribed_motion
from model.scene.selection import check_prescribed
from model.scene.string_terms import with_modes
from model.sensitivity.observed import observable_derivatives
from model.sensitivity.options import SensitivityOptions
from model.sensitivity.parameter_names import describe_parameters, directions, find_parameters, refuse_idle
from model.sensitivity.result import Sensitivities
from model.sensitivity.tangents import RecordedMotion, rest_derivatives
from model.simulation.run import Simulation, State, complete_memory
from model.simulation.statics import solve_rest, with_pins

Array = NDArray[np.float64]


def motion_sensitivities(
    action: ActionLike,
    motion: tuple[ArrayLike, ArrayLike] | KeyMotion,
    parameters: Sequence[str],
    *,
    from_rest: bool = True,
    options: SensitivityOptions | None = None,
) -> Sensitivities:
    """Differentiate by parameters what follows from a motion (times s, angles rad counter-clockwise) of the key: other
    bodies' angles, and force that holds to it; ``from_rest``: angles are from rest, else from ground.

    In every scene: of the key, of its front where it lifts or its joint gives, of a motor arm or a finger, as
    `simulate_motion` has it.

    Parameters
    ----------
    action : parameter set, or its name or file
    motion : times (k,), s, and angles (k,), rad, counter-clockwise; or a motion that was fitted to them
    parameters : names (P,) as for `sensitivities`
    from_rest : the angles are changes since rest, as an incremental encoder gives them; else from ground, in which
        case they do not depend on any parameter
    options : tolerances, times and scene, and the input under which the action rests; events and contact forces are
        not given

    Returns
    -------
    Sensitivities
        Derivatives (T, n, P) of the angles, that of the motion last, and (T, P) of the force, per SI unit of each
        parameter.

    Raises
    ------
    InputError : a name is unknown, has no effect in the scene or does nothing under this motion; options ask for
        contact forces or an error; a table that cannot be used
    StaticsError, IntegrationError : the action has no rest state, or cannot follow the motion

    Examples
    --------
    >>> import model
    >>> time_s, key_rad = model.read_motion_table("key.csv")
    >>> found = model.motion_sensitivities("hirschkorn2004", (time_s, key_rad), ["hammer.mass", "contact07"])
    >>> found.d_angles.shape == (len(time_s), 5, 2), found.d_force.shape == (len(time_s), 2)
    (True, True)
    """
    action = as_action(action)
    options = SensitivityOptions(events=False) if options is None else options
    _refuse_force_options(options)
    action, choice = options.resolve(load_action(action) if isinstance(action, str) else action)
    check_prescribed(choice)
    action = with_modes(action, options.tolerance)
    named = find_parameters(action, parameters)
    free = build_scene(action, choice)
    fitted, table_s = _fit_motion(motion)
    outputs = check_output_times(options.output_time_s, table_s)
    if len(outputs) == 0:
        raise InputError("output times: found none, allowed at least one")
    carried = np.zeros(len(named))
    if from_rest:
        at_rest = solve_rest(free, options.rest_input, with_joints=True)
        fitted = fitted.shift_angle(prescribed_angle(free, choice.moved, at_rest, free.vector))
        of_free = directions(action, choice, named)
        own = rest_derivatives(of_free, at_rest, options.rest_input)[None]

        def begins_at(whole: Array, _: Array, p: Array) -> Array:
            return np.array(prescribed_angle(free, choice.moved, whole[0], p))

        carried = observable_derivatives(
            of_free, begins_at, (at_rest[None], 0.0 * at_rest[None]), (own, 0.0 * own), True
        )
    begins = float(fitted.break_s[0])  # from zero on, as in a run
    key = KeyMotion(fitted.break_s - begins, fitted.coefficient)
    slopes = directions(action, choice, named, key)
    scene = slopes.scene
    tables, n = scene.tables, scene.size
    state = complete_memory(scene, State(0.0, solve_rest(scene, 0.0), np.zeros(n)))
    whole = with_pins(scene, state.angle_rad, 0.0) if scene.pins else state.angle_rad
    simulation = Simulation(scene, state, options.tolerance, options.method, largest_step_s=LONGEST_STEP_S)
    span, wanted = key.break_s[[0, -1]], outputs - begins
    recorded = RecordedMotion(slopes, simulation, float(wanted[-1]), (span, span), (whole, 0.0), carried)
    followed = recorded.follow(wanted, options.relative_tolerance, scene.remembers)
    moved, remembered = key.evaluate(wanted), recorded.whole_states(wanted)[:, 2 * n :]
    arm = None if choice.moved == "key" else f"{ARM if choice.moved == MOTOR else FINGER}.length"

    def true_states(q: Array, v: Array, z: Array, moved_rad: Array, p: Array) -> Array:
        """True angles and speeds of all coordinates, side by side."""
        return np.hstack(append_prescribed_motion(tables, p, (q, v), np.column_stack([moved_rad, moved[:, 1]]), z))

    def holding(q: Array, v: Array, z: Array, moved_rad: Array, p: Array) -> Array:
        states = np.hsplit(true_states(q, v, z, moved_rad, p), 2)
        return key_load(scene, states[0], states[1], moved[:, 2], p, z)[0]

    states = (*recorded.states(wanted), remembered, moved[:, 0])
    d_moved = np.broadcast_to(carried, (len(wanted), len(named)))
    d_states = followed.angle, followed.speed, recorded.remembered_slopes(followed, remembered.shape[1]), d_moved
    angle, speed = np.hsplit(true_states(*states, scene.vector), 2)
    d_angle, d_speed = np.hsplit(observable_derivatives(slopes, true_states, states, d_states, True), 2)
    d_angle[:, :n], d_speed[:, :n] = followed.angle, followed.speed  # not rounded again
    force, d_force = holding(*states, scene.vector), observable_derivatives(slopes, holding, states, d_states)
    if arm is not None:  # the torque on its joint over its length
        longer = np.array([p.paths.get(arm, 0.0) for p in named])
        force, d_force = force / action[arm], (d_force - np.outer(force / action[arm], longer)) / action[arm]
    idle = tuple(p.name for j, p in enumerate(named) if not (np.any(d_angle[:, :, j]) or np.any(d_force[:, j])))
    refuse_idle(idle, options.allow_idle, "stroke")
    return Sensitivities(
        **describe_parameters(action, named),
        time_s=outputs,
        angle_names=scene.bodies,
        angles_rad=angle,
        speeds=speed,
        d_angles=d_angle,
        d_speeds=d_speed,
        rest_rad=np.append(recorded.rest, moved[0, 0]),
        d_rest=np.vstack([recorded.d_rest, carried]),
        force_n=force,
        d_force=d_force,
        idle=idle,
        counters=followed.counters,
        tolerance=options.tolerance,
        relative_tolerance=options.relative_tolerance,
    )


def _fit_motion(motion: tuple[ArrayLike, ArrayLike] | KeyMotion) -> tuple[KeyMotion, Array]:
    if isinstance(motion, KeyMotion):
        return motion, motion.break_s
    fit = fit_key_motion(*motion)
    return fit.motion(), fit.time_s


def _refuse_force_options(options: SensitivityOptions) -> None:
    """Refuse options that hold only where a force drives the key."""
    asked = {
        "contact_forces": options.contact_forces,
        "estimate_error": options.estimate_error,
        "events": options.events,
    }
    wrong = [name for name, it_is in asked.items() if it_is]
    if wrong:
        raise InputError(
            f"sensitivities under a motion of the key: found {', '.join(wrong)}, allowed tolerances, times, scene, "
            "method, rest_input and allow_idle"
        )
