"""Forces, sliding, losses and accelerations at each contact, joint and body along a motion, over the output times.

World frame: x right, y up. Signs: docs/explanation/signs.md.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.arrays import as_numbers
from model.codegen import observable_columns as C
from model.errors import InputError
from model.inside.state_observer import ObservedStates, Observer
from model.parameters.effects import RAIL
from model.scene.build import Scene
from model.simulation.loads_and_losses import Inside, RailLift, RailTension, lifts, tensions  # noqa: F401  public
from model.simulation.negative_contact_force import check_pushes

Array = NDArray[np.float64]

# powers in the action are sharp peaks where felt is hit or sliding turns round: equal steps miss them or waste work
SPLIT = 4  # parts a panel is split into
MOST_POINTS = 60_000  # of a motion: some 2 kB each, 120 MB in all


@dataclass(frozen=True)
class Panels:
    """Integrals over (k,) consecutive panels."""

    end_s: Array  # (k,) where each panel ends, s
    integral: Array  # (k, f) integral of each rate
    rest: Array  # (k,) what the integrals leave unexplained of the change of the level
    error_bound: Array  # (k,) bound on the error of the integrals, all together
    level: Array  # (k,) level at the end of the panel
    points: int  # times sampled


def panel_edges(start: float, end: float, longest: float, *inside: Array) -> Array:
    """Edges from ``start`` to ``end`` (s), no panel longer than ``longest``, with all given times between them."""
    count = 1 + max(1, round((end - start) / longest))
    given = [times[(times > start) & (times < end)] for times in inside]
    return np.unique(np.concatenate([np.linspace(start, end, count), *given]))


def integrate_panels(
    sample: Callable[[Array], tuple[Array, Array]],
    edges: Array,
    sign: Array,
    allowed: Callable[[], float],
    rounds: int,
) -> Panels:
    """Integrate rates (m, f) over panels between ``edges`` (k + 1,), s, split up to ``rounds`` times while their errors
    exceed ``allowed()``; ``sample``: times -> rates and a level, which changes by ``sign`` (f,) times the integral.

    Parameters
    ----------
    sample : gives rates (m, f) and a level (m,) at increasing times (m,); called once per round
    sign : (f,) the level should change by the sum of sign times integral
    allowed : error of one panel that is small enough; asked after the first round
    rounds : how often panels are split at most
    """
    left, right = edges[:-1], edges[1:]
    accepted: list[tuple[Array, ...]] = []
    points = 0
    for level in range(rounds + 1):
        times = left[:, None] + (right - left)[:, None] * np.linspace(0.0, 1.0, SPLIT + 1)
        times[:, SPLIT] = right  # exactly, so that neighbours share it
        distinct, back = np.unique(times, return_inverse=True)
        back = back.reshape(times.shape)
        points += len(distinct)
        rates, at = sample(distinct)
        flows, total = np.moveaxis(rates[back], 1, 2), at[back]  # (panels, f, 5), (panels, 5)
        width = (right - left)[:, None]
        coarse = width / 6.0 * (flows[..., 0] + 4.0 * flows[..., 2] + flows[..., 4])
        fine = width / 12.0 * (flows @ np.array([1.0, 4.0, 2.0, 4.0, 1.0]))
        rest = fine @ sign - (total[:, 4] - total[:, 0])
        error_bound = np.abs(fine - coarse).sum(axis=1) / 15.0
        worst = np.maximum(np.abs(rest), error_bound)
        coarse_still = open_ = ~(worst <= allowed())
        room = (MOST_POINTS - points) // (4 * SPLIT) if level < rounds else 0
        if open_.sum() > room:  # the worst first
            open_ = open_ & np.isin(np.arange(len(worst)), np.argsort(-worst)[: max(room, 0)])
        # a panel given up before Simpson's rule settles is not yet in the range where fine - coarse shrinks by 15
        error_bound = np.where(coarse_still, 15.0 * error_bound, error_bound)
        done = ~open_
        accepted.append((right[done], fine[done], rest[done], error_bound[done], total[done, 4]))
        if not open_.any():
            break
        parts = left[open_, None] + (right - left)[open_, None] * np.linspace(0.0, 1.0, SPLIT + 1)
        parts[:, -1] = right[open_]
        left, right = parts[:, :-1].ravel(), parts[:, 1:].ravel()
    columns = [np.concatenate(part) for part in zip(*accepted, strict=True)]
    order = np.argsort(columns[0])
    ends, integral, rests, doubts, levels = (column[order] for column in columns)
    return Panels(ends, integral, rests, doubts, levels, points)


States = Callable[[Array], tuple[Array, ...]]

GOAL = 1e-6  # error of what accumulates, as a share of all losses
LONGEST_PANEL_S = 5e-4  # s: two or more within any contact of hammer and string
ROUNDS = 5  # of halving panels until integrals are within the tolerance
AT_ONCE = 2000  # states; what they say of every contact takes 2 kB each


class _Record:
    """All states that were evaluated: their times, joint forces and rail depth, the largest contact forces."""

    def __init__(self, scene: Scene) -> None:
        self.time_s: list[Array] = []
        self.joint_n: list[Array] = []
        self.rail_m: list[Array] = []
        self.largest_n = np.zeros(len(scene.contacts))
        self.rail = scene.contacts.index(RAIL) if RAIL in scene.contacts else None

    def add(self, times: Array, states: ObservedStates) -> None:
        contact = states.contact
        self.time_s.append(times)
        self.joint_n.append(states.joint_forces().copy())
        self.rail_m.append(np.zeros(len(times)) if self.rail is None else contact[:, self.rail, C.DEPTH].copy())
        self.largest_n = np.maximum(self.largest_n, contact[:, :, C.NORMAL].max(axis=0, initial=0.0))


def observe(
    scene: Scene, states: States, time_s: ArrayLike, start: float, input_time_s: ArrayLike, value: ArrayLike
) -> Inside:
    """Forces, accelerations, sliding and losses at ``time_s`` along a motion: ``states`` gives angles, speeds (and
    internal variables) at any times from ``start``, s; ``value`` (k,): input at ``input_time_s``.

    Parameters
    ----------
    scene : what took part
    states : gives angles and speeds, (m, n) each, and, where felt, joints or a string remember, rows (m, z) of that, at
        increasing times (m,) s from ``start``; called a few times
    time_s : (m,) times of the rows to return
    start : time at which the run began, s; sliding and losses accumulate from here
    input_time_s, value : (k,) input of the run, linear between its points

    Returns
    -------
    Inside
        Arrays of m rows; `Inside.columns` names each with its unit.

    Raises
    ------
    InputError : arrays that are no rows of numbers, or states of another scene

    Examples
    --------
    >>> import numpy as np
    >>> import model
    >>> action, (time_s, force_n) = model.load_action(), model.force_table("forte")
    >>> still = model.rest_state(action).angle_rad
    >>> def states(at):
    ...     return np.tile(still, (len(at), 1)), np.zeros((len(at), 5))
    >>> inside = model.inside.observe(model.build_scene(action), states, time_s[:10], 0.0, time_s, force_n)
    >>> inside.time_s.shape
    (10,)
    """
    observer, record = Observer(scene), _Record(scene)
    wanted, input_s = as_numbers(time_s, "times to observe", 1), as_numbers(input_time_s, "input times", 1)
    given = as_numbers(value, "input", 1)
    if given.shape != input_s.shape:
        raise InputError(f"input: found {input_s.shape} times and {given.shape} values, allowed as many")
    if scene.command is not None:
        input_s, given = scene.command.table(input_s, given, False)
    c, n, b = len(scene.contacts), scene.size, len(scene.tables.probe)
    width = 3 * c + n + b

    def evaluate(times: Array) -> ObservedStates:
        angle, speed, *rows = states(times)
        found = observer.evaluate(angle, speed, np.interp(times, input_s, given), *rows)
        check_pushes(scene, times, found.contact, rows[0] if rows else None)
        record.add(times, found)
        return found

    work: list[float] = []  # all losses, from the first round of panels

    def flows(times: Array) -> Array:
        at = evaluate(times)
        lost = [at.contact[:, :, C.RUBBED], at.contact[:, :, C.FELT], at.body[:, :, C.BRAKED], at.tip[:, :, 1]]
        return np.concatenate([*lost, np.abs(at.contact[:, :, C.SLIDE])], axis=1)

    def rates(times: Array) -> tuple[Array, Array]:
        found = np.concatenate([flows(part) for part in np.array_split(times, len(times) // AT_ONCE + 1)])
        if not work:
            work.append(float(np.trapezoid(np.abs(found[:, : width - c]).sum(axis=1), times)))
        return found, np.zeros(len(times))

    end = float(wanted[-1]) if len(wanted) else start
    totals = np.zeros((len(wanted), width))
    error = 0.0
    if end > start:
        edges = panel_edges(start, end, LONGEST_PANEL_S, wanted, input_s)
        panels = integrate_panels(rates, edges, np.zeros(width), lambda: GOAL * work[0] / len(edges), ROUNDS)
        sums = np.vstack([np.zeros(width), np.cumsum(panels.integral, axis=0)])
        totals = sums[np.searchsorted(panels.end_s, wanted, side="right")]
        error = float(panels.error_bound.sum())
    at = evaluate(wanted)
    rubbed, felt, joint, tip, slid = np.split(totals, np.cumsum([c, c, n, b]), axis=1)
    dense, first = np.unique(np.concatenate(record.time_s), return_index=True)
    return Inside(
        scene=scene,
        time_s=wanted,
        normal_n=at.contact[:, :, C.NORMAL],
        friction_n=at.contact[:, :, C.FRICTION],
        penetration_m=at.contact[:, :, C.DEPTH],
        sliding_m_per_s=at.contact[:, :, C.SLIDE],
        slid_m=slid,
        rubbed_j=rubbed,
        felt_j=felt,
        point_m=at.contact[:, :, C.X : C.Y + 1],
        tip_n=at.tip[:, :, 0],
        tip_j=tip,
        joint_n=record.joint_n[-1],
        joint_j=joint,
        center_m_per_s=at.velocity,
        center_m_per_s2=at.acceleration,
        angle_rad_per_s=at.body[:, :, C.TURNING],
        angle_rad_per_s2=at.turning,
        pose=at.poses(),
        largest_normal_n=record.largest_n,
        dense_time_s=dense,
        dense_joint_n=np.concatenate(record.joint_n)[first],
        dense_rail_m=np.concatenate(record.rail_m)[first],
        error_j=error,
    )
