"""Derivatives of a blow with respect to parameters of the action: the function `model.sensitivities`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.arrays import as_numbers
from model.errors import InputError
from model.files.force_table import check_force_table
from model.force_driven import COMPANION, Recorded, check_output_times, force_table_of_trial
from model.parameters.action import Action, ActionLike, as_action
from model.sensitivity.events import Events
from model.sensitivity.options import SensitivityOptions
from model.sensitivity.parameter_names import (
    LENGTH_STEP,
    describe_parameters,
    directions,
    find_parameters,
    refuse_idle,
)
from model.sensitivity.result import Sensitivities
from model.sensitivity.tangents import RecordedMotion
from model.simulation.run import Simulation, State, complete_memory
from model.simulation.statics import RestState, rest_state, with_pins

Array = NDArray[np.float64]
Blow = tuple[ArrayLike, ArrayLike]


def sensitivities(
    action: ActionLike,
    blow: Blow | Recorded,
    parameters: Sequence[str],
    *,
    options: SensitivityOptions | None = None,
    inputs: tuple[ArrayLike, ArrayLike] | None = None,
) -> Sensitivities:
    """Differentiate a blow (times s, forces N, or a record) by parameters, per SI unit of each: angles, speeds, events,
    contact forces, rest state; ``inputs``: also along changes (k, m) of its force, and (m,) of that at rest.

    Parameters
    ----------
    action : parameter set, or its name or file
    blow : times (k,), s, and forces (k,), N, as `model.simulate` takes them; the motor's torque with a motor arm; or a
        recorded trial
    parameters : names (P,): paths such as ``hammer.mass``, or laws, groups and patterns (``friction``, ``contact02`` or
        ``felt:contact02``, ``*.mass``), which stand for a factor of 1
    options : tolerances, times, scene and what else to give
    inputs : changes (k, m) of the blow's force at its times, and (m,) of the input it rests under, by which it is to be
        differentiated, too

    Returns
    -------
    Sensitivities
        The blow and its derivatives (T, n, P), per SI unit of each parameter; after them those by the inputs, per unit
        of each change.

    Raises
    ------
    InputError : a name is unknown, has no effect in the scene or does nothing in this blow; a table that cannot be used
    StaticsError, IntegrationError : the action has no rest state, or the blow cannot be simulated

    Notes
    -----
    The derivatives are those of the exact motion: they are integrated beside it with their own error control and land
    on the kinks of the contacts; no step of a difference has to be chosen (docs/explanation/sensitivities.md).
    Where a contact only just touches at rest they hold on one side alone; such contacts are named in ``at_kink``.

    Examples
    --------
    >>> import model
    >>> blow = model.force_table("forte")
    >>> found = model.sensitivities("hirschkorn2004", blow, ["hammer.mass", "friction"])
    >>> found.d_angles.shape
    (3501, 5, 2)
    >>> print(f"{0.01 * found.d_events['strike_m_per_s'][1]:.3f} m/s for 1 % more friction")
    -0.001 m/s for 1 % more friction
    >>> table, ax = found.to_frame(), found.plot("hammer")
    """
    chosen = as_action(action)
    options = SensitivityOptions() if options is None else options
    if not isinstance(blow, tuple | list):
        times, forces, preload_n, sampled = force_table_of_trial(blow)
        at = sampled if options.output_time_s is None else options.output_time_s
        blow, options = (times, forces), replace(options, rest_input=preload_n, output_time_s=at)
    found = _differentiate_blow(chosen, blow, parameters, options, inputs)
    if options.estimate_error:
        finer = replace(
            options,
            tolerance=COMPANION * options.tolerance,
            relative_tolerance=COMPANION * options.relative_tolerance,
            contact_forces=False,
            events=False,
        )
        other = _differentiate_blow(chosen, blow, parameters, finer, inputs)
        found = replace(found, estimated_error=_largest_difference(found.d_angles, other.d_angles))
    return found


def _differentiate_blow(
    action: Action, blow: Blow, parameters: Sequence[str], options: SensitivityOptions, inputs: Blow | None
) -> Sensitivities:
    """Sensitivities of a blow, a table (times s, forces N), by named parameters, and by ``inputs``, changes (k, m) of
    its force with those (m,) of that at rest."""
    times, forces = check_force_table(*blow)
    outputs = check_output_times(options.output_time_s, times)
    action, choice = options.resolve(action)
    named = find_parameters(action, parameters) if len(parameters) or inputs is None else []
    slopes = directions(action, choice, named)
    if inputs is not None:
        slopes = slopes.with_inputs(*_check_input_changes(inputs, len(times)))
    scene = slopes.scene
    start = rest_state(action, options.rest_input, scene)
    whole = with_pins(scene, start.angle_rad, options.rest_input) if scene.pins else start.angle_rad
    state = State(float(times[0]), start.angle_rad.copy(), np.zeros(scene.size))
    state = complete_memory(scene, state, options.rest_input)
    simulation = Simulation(scene, state, options.tolerance, options.method)
    end = float(outputs[-1]) if len(outputs) else float(times[-1])
    recorded = RecordedMotion(slopes, simulation, end, (times, forces), (whole, options.rest_input))
    events = Events(action, recorded, (float(times[0]), end))
    at_events = events.find() if options.events else np.empty(0)
    wanted = np.concatenate([outputs, at_events])
    followed = recorded.follow(wanted, options.relative_tolerance, options.contact_forces)
    idle = tuple(p.name for p, it_does in zip(named, followed.acts, strict=False) if not it_does)
    refuse_idle(idle, options.allow_idle, "blow")
    rows = len(outputs)
    states = recorded.whole_states(outputs)
    out = Sensitivities(
        **describe_parameters(action, slopes.parameters),
        time_s=outputs,
        angle_names=scene.bodies,
        angles_rad=np.ascontiguousarray(states[:, : scene.size]),
        speeds=np.ascontiguousarray(states[:, scene.size : 2 * scene.size]),
        d_angles=followed.angle[:rows],
        d_speeds=followed.speed[:rows],
        rest_rad=recorded.rest,
        d_rest=recorded.d_rest,
        idle=idle,
        at_kink=_is_at_kink(start),
        counters=followed.counters,
        tolerance=options.tolerance,
        relative_tolerance=options.relative_tolerance,
    )
    if options.events:
        slopes_there = followed.whole_angle[rows:], followed.whole_speed[rows:]
        values, d_values = events.differentiate(at_events, slopes_there)
        out = replace(out, events=values, d_events=d_values, absent_events=events.absent)
    if options.contact_forces:
        slopes_of_state = followed.whole_angle[:rows], followed.whole_speed[:rows], followed.channel[:rows]
        normal, d_normal = recorded.normal_forces(states, slopes_of_state)
        out = replace(out, contact_names=scene.contacts, contact_forces=normal, d_contact_forces=d_normal)
    return out


def _check_input_changes(inputs: Blow, rows: int) -> tuple[Array, Array]:
    """Check and return changes (rows, m) of an input of ``rows`` samples, and those (m,) at rest."""
    table, rest = (as_numbers(given, "inputs", ndim) for given, ndim in zip(inputs, (2, 1), strict=True))
    if table.shape != (rows, *rest.shape) or not (np.isfinite(table).all() and np.isfinite(rest).all()):
        raise InputError(
            f"inputs: found changes of shape {table.shape}, {rest.shape} at rest, allowed ({rows}, m) and (m,), finite"
        )
    return table, rest


def _is_at_kink(start: RestState) -> tuple[str, ...]:
    near = np.abs(start.penetration_m) < LENGTH_STEP  # a difference would step over it
    return tuple(name for name, it_is in zip(start.contacts, near, strict=True) if it_is)


def _largest_difference(d_angles: Array, others: Array) -> float:
    size = np.max(np.abs(others), axis=0, initial=0.0)
    apart = np.max(np.abs(d_angles - others), axis=0, initial=0.0)
    return float(np.max(np.divide(apart, size, out=np.zeros_like(apart), where=size > 0.0), initial=0.0))
