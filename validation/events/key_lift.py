"""False readings of the key encoder: the key lifts off its balance rail, and its scale reads the lift as rotation.

Conventions: m and s on the DAQ clock. Gap: of capstan and whippen heel, computed from key and whippen encoder, negative
where the felt is pressed in. A scale of radius R whose centre rises by d reads d/R too much, so that a capstan r
behind the pivot seems to drop by d·r/R and rises by d: a lift of 0.1 mm looks like a gap of half a millimetre.
Source: thesis Sections 3.2.2 and 4.1, where film showed it. Three things tell a lift from a capstan that really parts:

- the gap is larger than the model's, at any time near enough for the model to be early or late;
- the capstan is loaded: part of the time the whippen is accelerated upwards of its free fall, so something carries it,
  or the model's capstan is pressed in while its balance rail would have to pull the key down;
- that pull of the model's rail is stated with each interval, and its absence too.

A sample inside a lift stays in the traces and figures and is left out of every score. A trial without an impact is
judged with the widest allowance for timing.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d

import model
from model.parameters.action import CONTACTS, USUAL
from validation.conventions import KEY, WHIPPEN, Array
from validation.events.definitions import Event
from validation.events.encoder_readings import find_reading_faults
from validation.events.miswired_encoders import find_miswired_channels
from validation.measurement.measure_session import select_representative
from validation.measurement.trial import MeasuredTrial
from validation.prediction.model_under_test import ModelUnderTest
from validation.prediction.predict_session import PredictedSession

EXCESS_M = 0.2e-3  # of the gap, as a lift by 0.04 mm makes: choice
EDGE_M = 0.05e-3  # of the gap, at an interval's ends: some ten counts of the key's scale
NEAR_S = (1.5e-3, 3e-3, 10e-3)  # how early or late the model may be: before the impact, until release, after it
NEAR_EDGE_S = NEAR_S[-1]  # to which an interval reaches at most to its ends, and a pull of the rail may lie away
CARRIED_SHARE = 0.1  # of an interval: choice
FREE_SHARE = 0.7  # of the free fall of the whippen: faster is falling, slower is carried
FALL_WINDOW_S = 2e-3  # of the whippen's acceleration, and gap in an interval that is none: choice
# 8192 lines of 20 µm; only turns a gap into a lift for the reader
SCALE_RADIUS_M = 0.02608


@dataclass(frozen=True)
class KeyLift:
    """One lift, an interval left out of the scores.

    Its ends, when and how large the excess gap was, the lift it stands for, the pull of the model's rail.
    """

    start_s: float
    end_s: float
    largest_at_s: float
    gap_m: float
    lift_m: float
    rail_pull_n: float
    reason: str


@dataclass(frozen=True)
class RailPull:
    """An interval in which the model's balance rail would have to pull the key down, and the largest pull."""

    start_s: float
    end_s: float
    largest_n: float


@dataclass(frozen=True)
class Capstan:
    """Geometry of the capstan: its gap by the angles, the whippen's free fall, gap per lift of the key."""

    gap_m: Callable[[Array], Array]
    free_fall_rad_per_s2: float
    gap_per_lift: float


def make_capstan(action: model.Action) -> Capstan:
    """Capstan of an action: its gap, m, as a function of absolute angles (n, 5), the whippen's angular acceleration in
    free fall, rad/s², and the apparent gap per lift of the key.

    The free fall is that of whippen, jack and repetition lever together about the whippen's pivot; a hammer resting on
    them only makes it faster.
    """
    moment = inertia = 0.0
    for body in ("whippen", "jack", "repetition"):
        at_x = at_y = 0.0
        if body != "whippen":
            at_x, at_y = action[f"{body}.pivot.x"], action[f"{body}.pivot.y"]
        mass = action[f"{body}.mass"]
        reach = np.hypot(at_x, at_y) + (action["whippen.center_of_mass.x"] if body == "whippen" else 0.0)
        moment += mass * (at_x if body != "whippen" else action["whippen.center_of_mass.x"])
        inertia += action[f"{body}.inertia"] + mass * reach**2
    fall = -action["gravity.g"] * moment / inertia
    lever = abs(action["contact01.first.x"])

    def gap(angle: Array) -> Array:
        return np.asarray(model.observables.capstan_gap_m(action, angle), dtype=float)

    return Capstan(gap, float(fall), 1 + lever / SCALE_RADIUS_M)


def find_lifts(
    capstan: Capstan,
    time_s: Array,
    measured_rad: Array,
    predicted_rad: Array,
    *,
    impact_s: float,
    release_s: float,
    rail: Callable[[], list[RailPull]] | None = None,
) -> list[KeyLift]:
    """Lifts of the key off its rail: intervals in which the capstan gap from ``measured_rad`` (n, 5), absolute angles,
    exceeds that from ``predicted_rad`` by over 0.2 mm though the capstan is loaded; ``rail`` returns when the model's
    rail would pull it.

    Parameters
    ----------
    time_s : (n,), uniform
    measured_rad, predicted_rad : (n, 5), absolute angles; of the measured ones key and whippen are used
    impact_s, release_s : of the trial, NaN where absent
    rail : gives intervals in which the model's rail would have to pull; called only when there is something to decide
    """
    gap = capstan.gap_m(measured_rad)
    expected = _widen_gap(time_s, capstan.gap_m(predicted_rad), impact_s, release_s)
    excess = gap - expected
    over = np.flatnonzero(np.isfinite(excess) & (excess > EXCESS_M))
    if over.size == 0:
        return []
    step = float(np.median(np.diff(time_s)))
    model_gap = capstan.gap_m(predicted_rad)
    pulls = rail() if rail is not None else None
    carried = _is_carried(measured_rad[:, WHIPPEN], step, capstan.free_fall_rad_per_s2)
    found = []
    for run in np.split(over, np.flatnonzero(np.diff(over) > round(FALL_WINDOW_S / step)) + 1):
        begin, end = float(time_s[run[0]]), float(time_s[run[-1]])
        loaded = carried[run[0] : run[-1] + 1].mean() >= CARRIED_SHARE
        pressed = bool(np.median(model_gap[run]) < 0.0)
        if not (loaded or (pressed and _select_near(pulls, begin, end))):
            continue
        first, last = _find_edges(gap - model_gap, run, round(NEAR_EDGE_S / step))
        found.append(_make_lift(capstan, time_s, excess, first, last, pulls))
    return _join_lifts(found)


def _select_near(pulls: list[RailPull] | None, start_s: float, end_s: float) -> list[RailPull]:
    return [t for t in pulls or [] if t.start_s - NEAR_EDGE_S <= end_s and t.end_s + NEAR_EDGE_S >= start_s]


def _widen_gap(time: Array, gap: Array, impact_s: float, release_s: float) -> Array:
    """Model's largest capstan gap (n,), m, 0 or more, within the time by which the model may be early or late: 1.5 ms
    before the impact, 3 ms until the release, 10 ms after it."""
    known = np.where(np.isfinite(gap), gap, -np.inf)
    step = float(np.median(np.diff(time)))
    reach = [maximum_filter1d(known, 2 * round(near / step) + 1, mode="nearest") for near in NEAR_S]
    out = np.where(time < impact_s - NEAR_S[1], reach[0], reach[1]) if np.isfinite(impact_s) else reach[1]
    if np.isfinite(release_s):
        out = np.where(time > release_s - NEAR_S[2], reach[2], out)
    return np.where(np.isfinite(gap), np.maximum(out, 0.0), np.nan)


def _is_carried(whippen_rad: Array, step: float, free_fall: float) -> NDArray[np.bool_]:
    # start-up: scipy.signal costs 0.3 to 0.6 s, only doubtful trials need it
    from scipy.signal import savgol_filter

    window = max(2 * round(FALL_WINDOW_S / step / 2) + 1, 5)  # samples, of a parabola
    acceleration = savgol_filter(whippen_rad, window, 2, deriv=2, delta=step)
    return np.asarray(acceleration > FREE_SHARE * free_fall)


def _find_edges(excess: Array, samples: NDArray[np.intp], longest: int) -> tuple[int, int]:
    """First and last sample of an interval, given by its ``samples``, widened by up to ``longest`` samples at each end
    while the excess (m) is above `EDGE_M`."""
    first, last = int(samples[0]), int(samples[-1])
    while first > 0 and samples[0] - first < longest and excess[first - 1] > EDGE_M:
        first -= 1
    while last + 1 < excess.size and last - samples[-1] < longest and excess[last + 1] > EDGE_M:
        last += 1
    return first, last


def _make_lift(
    capstan: Capstan, time: Array, excess: Array, first: int, last: int, pulls: list[RailPull] | None
) -> KeyLift:
    """Lift of the key over samples ``first`` to ``last``, with its largest ``excess`` (n,), m: measured capstan gap
    less the model's; ``pulls``: when the model's rail would have to pull the key down, which the reason names, None
    where unknown."""
    part = excess[first : last + 1]
    worst = first + int(np.nanargmax(part))
    gap = float(excess[worst])
    lift = gap / capstan.gap_per_lift
    reason = f"the gap at the loaded capstan, by key and whippen encoder, is {1e3 * gap:.2f} mm larger than the model's"
    pull = float("nan")
    if pulls is not None:
        near = _select_near(pulls, float(time[first]), float(time[last]))
        pull = max((float(t.largest_n) for t in near), default=0.0)
        reason += (
            f"; the model's balance rail pulls with {pull:.1f} N there"
            if near
            else "; the model's balance rail does not pull there"
        )
    return KeyLift(float(time[first]), float(time[last]), float(time[worst]), gap, lift, pull, reason)


def _join_lifts(lifts: list[KeyLift]) -> list[KeyLift]:
    """Lifts, given in order of their start, with those that overlap merged; the larger gap gives all but the ends."""
    out: list[KeyLift] = []
    for lift in lifts:
        if out and lift.start_s <= out[-1].end_s:
            larger = max(out[-1], lift, key=lambda x: x.gap_m)
            out[-1] = replace(larger, start_s=out[-1].start_s, end_s=max(out[-1].end_s, lift.end_s))
        else:
            out.append(lift)
    return out


def find_key_lifts(
    predicted: PredictedSession, tested: ModelUnderTest, events: dict[int, dict[str, Event]]
) -> dict[int, list[KeyLift]]:
    """Lifts of the key by trial number, empty in trials whose encoders are wired wrong or whose key or whippen leaps or
    stands still; ``events``: the trials', trial number → name → event.

    The rail's pull is computed for the trial of median peak force, and moved to each trial's own impact.
    """
    capstan = make_capstan(tested.action)
    middle = select_representative(predicted.trials)

    @cache
    def pulls() -> tuple[RailPull, ...]:
        return tuple(find_rail_pulls(tested, middle))

    def impact(number: int) -> float:
        return events[number]["string_impact"].value

    def moved(number: int) -> list[RailPull]:
        by = impact(number) - impact(middle.number)
        if math.isnan(by):  # no impact in one of them
            by = 0.0
        return [replace(t, start_s=t.start_s + by, end_s=t.end_s + by) for t in pulls()]

    found: dict[int, list[KeyLift]] = {}
    for m in predicted.trials:
        angles = predicted.predictions[m.number].model
        if find_miswired_channels(m, angles) or any(
            fault.channel != "hammer" for fault in find_reading_faults(m, angles)
        ):
            found[m.number] = []
            continue
        geometry = tested.geometry_at(m.force.preload_n)
        found[m.number] = find_lifts(
            capstan,
            m.time_s,
            geometry.absolute({KEY: m.change_rad[:, 0], WHIPPEN: m.change_rad[:, 1]}),
            angles.angle_rad,
            impact_s=impact(m.number),
            release_s=events[m.number]["key_release"].value,
            rail=partial(moved, m.number),
        )
    return found


def find_rail_pulls(tested: ModelUnderTest, m: MeasuredTrial) -> list[RailPull]:
    """Intervals, s, with the largest pull, N, in which the model's balance rail would have to pull the key down under
    this trial's force; empty for a stand-in. Simulates with inner forces, which is slow, unless the store has it.

    A run that records the inner forces costs some eighty times a prediction: it is made for one trial, and only when
    there is a doubt. A stand-in for the model has no inner forces. Felt that remembers gives way to the thesis's law
    with the same slow curves, for which alone inner forces are known: the pull says when to doubt, it is no result.
    """
    if tested.stand_ins.predict is not None:
        return []
    force = m.force

    def run() -> list[tuple[float, float, float]]:
        rest = tested.load(force.preload_n).rest
        action = tested.action.with_laws(dict.fromkeys(CONTACTS, USUAL))
        found = tested.simulate(
            action, force.time_s, force.force_n, tolerance=tested.tolerance, initial=rest, inside=True
        )
        assert found.inside is not None
        return [(pull.start_s, pull.end_s, pull.largest_n) for pull in found.inside.key_tensions()]

    inputs = (tested.identity, force.time_s, force.force_n, force.preload_n)
    return [RailPull(*pull) for pull in tested.store.value("look inside", inputs, run)]


def mark_lifted_samples(time_s: Array, lifts: Sequence[KeyLift]) -> NDArray[np.bool_]:
    out = np.zeros(len(time_s), dtype=bool)
    for lift in lifts:
        out |= (time_s >= lift.start_s) & (time_s <= lift.end_s)
    return out
