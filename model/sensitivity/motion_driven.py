"""Derivatives where the measured motion of the key drives the action: the function `model.motion_sensitivities`.

An encoder tells changes since rest, so the key's angle is its rest angle plus what was measured: the whole motion moves
with the rest angle, whose derivative enters as that of the prescribed coordinate.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.errors import InputError
from model.force_driven import check_output_times
from model.motion_driven.prescribed_key import LONGEST_STEP_S, key_load
from model.motion_driven.spline_fit import fit_key_motion
from model.parameters.action import Action, load_action
from model.parameters.effects import RAIL
from model.scene.build import build_scene
from model.scene.key_motion import KeyMotion
from model.scene.selection import check_prescribed
from model.sensitivity.observed import force_slopes
from model.sensitivity.options import SensitivityOptions
from model.sensitivity.parameter_names import directions, find_parameters, stated_uncertainty
from model.sensitivity.result import Sensitivities
from model.sensitivity.tangents import Recorded, key_rest_slopes
from model.simulation.run import Simulation, State
from model.simulation.statics import solve_rest

Array = NDArray[np.float64]


def motion_sensitivities(
    action: Action | str,
    motion: tuple[ArrayLike, ArrayLike] | KeyMotion,
    parameters: Sequence[str],
    *,
    from_rest: bool = True,
    options: SensitivityOptions | None = None,
) -> Sensitivities:
    """Differentiate what follows from a measured motion of the key: the other bodies' motion, the force at its front.

    Parameters
    ----------
    action : parameter set, or its name or file
    motion : times (k,), s, and angles of the key (k,), rad, counter-clockwise; or a motion that was fitted to them
    parameters : names (P,) as for `sensitivities`
    from_rest : the angles are changes since rest, as an incremental encoder gives them; else from ground, in which
        case they do not depend on any parameter
    options : tolerances, times and scene, and the force under which the key rests; events and contact forces are not
        given

    Returns
    -------
    Sensitivities
        Derivatives (T, n, P) of the angles, the key's last, and (T, P) of the force, per SI unit of each parameter.

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
    options = SensitivityOptions(events=False) if options is None else options
    _check(options)
    action, choice = options.of(load_action(action) if isinstance(action, str) else action)
    check_prescribed(choice)
    if choice.moved != "key" or RAIL in choice.effects:
        raise InputError(
            "sensitivities under a motion of the key: found an effect that lifts or presses the key "
            f"({', '.join(choice.effects)}), allowed a key on its pivot"
        )
    named = find_parameters(action, parameters)
    free = build_scene(action, choice)
    free.refuse_memory("sensitivities under a motion of the key")
    at_rest = solve_rest(free, options.rest_input)
    fitted, table_s = _fitted(motion)
    outputs = check_output_times(options.output_time_s, table_s)
    if len(outputs) == 0:
        raise InputError("output times: found none, allowed at least one")
    if from_rest:
        fitted = fitted.raised(float(at_rest[free.bodies.index("key")]))
    begins = float(fitted.break_s[0])  # from zero on, as in a run
    key = KeyMotion(fitted.break_s - begins, fitted.coefficient)
    slopes = directions(action, choice, named, key)
    carried = np.zeros(len(named))
    if from_rest:
        carried = key_rest_slopes(directions(action, choice, named), at_rest, options.rest_input)
    scene = slopes.scene
    state = State(0.0, solve_rest(scene, 0.0), np.zeros(scene.size))
    simulation = Simulation(scene, state, options.tolerance, options.method, largest_step_s=LONGEST_STEP_S)
    span, wanted = key.break_s[[0, -1]], outputs - begins
    recorded = Recorded(slopes, simulation, float(wanted[-1]), (span, span), (state.angle_rad, 0.0), carried)
    followed = recorded.follow(wanted, options.relative_tolerance)
    moved = key.at(wanted)
    angle, speed = (np.column_stack([own, moved[:, k]]) for k, own in enumerate(recorded.states(wanted)))
    d_angle = np.concatenate([followed.angle, np.broadcast_to(carried, (len(wanted), 1, len(named)))], axis=1)
    d_speed = np.concatenate([followed.speed, np.zeros((len(wanted), 1, len(named)))], axis=1)

    def force(q: Array, v: Array, p: Array) -> Array:
        return key_load(scene, q, v, moved[:, 2], p)[0][:, None]

    d_force = force_slopes(slopes, force, (angle, speed), (d_angle, d_speed))[:, 0]
    idle = tuple(p.name for j, p in enumerate(named) if not (np.any(d_angle[:, :, j]) or np.any(d_force[:, j])))
    if idle and not options.allow_idle:
        raise InputError(
            f"parameter {', '.join(idle)}: does nothing under this motion (its element stays out of touch or still); "
            "leave it out or choose another stroke"
        )
    return Sensitivities(
        parameters=tuple(p.name for p in named),
        values=np.array([p.value for p in named]),
        units=tuple(p.unit for p in named),
        uncertainties=np.array([stated_uncertainty(action, p.name) for p in named]),
        time_s=outputs,
        angle_names=scene.bodies,
        angles_rad=angle,
        speeds=speed,
        d_angles=d_angle,
        d_speeds=d_speed,
        rest_rad=np.append(recorded.rest, moved[0, 0]),
        d_rest=np.vstack([recorded.d_rest, carried]),
        force_n=force(angle, speed, scene.vector)[:, 0],
        d_force=d_force,
        idle=idle,
        counters=followed.counters,
        tolerance=options.tolerance,
        relative_tolerance=options.relative_tolerance,
    )


def _fitted(motion: tuple[ArrayLike, ArrayLike] | KeyMotion) -> tuple[KeyMotion, Array]:
    """The motion that drives, and the times of its table."""
    if isinstance(motion, KeyMotion):
        return motion, motion.break_s
    fit = fit_key_motion(*motion)
    return fit.motion(), fit.time_s


def _check(options: SensitivityOptions) -> None:
    """Refuse what only a blow by a force has."""
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
