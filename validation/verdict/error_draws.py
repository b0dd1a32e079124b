"""Comparison errors of a session, found and drawn: what enters the verdict's estimate.

What is common to all trials (parameters, gain, level and delay of the force, scales of the encoders, levels of rest) is
drawn on one representative trial of each condition. What each trial has for itself as declared (offset and noise
of its force, quantisation) is drawn apart, so that it is counted once: with the scatter of all trials it makes the one
variance component of `validation.verdict.estimate.draw_trial_scatter`.
"""

from __future__ import annotations

import base64
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from validation.conventions import ENCODER_CHANNELS, FILM_CHANNELS, Array
from validation.events.crossings import read_level
from validation.events.detect import find_events
from validation.events.session_events import SessionEvents
from validation.measurement.measure_session import select_representative
from validation.measurement.trial import MeasuredTrial
from validation.prediction.joint_draws import (
    CHANNELS,
    RULERS,
    JointDraw,
    joint_draws,
    own_draws,
    run_draws,
    session_seed,
)
from validation.prediction.model_under_test import ModelUnderTest
from validation.prediction.predict_session import PredictedSession
from validation.scores.traces import SessionTraces, select_scored_angles
from validation.verdict.estimate import ErrorSample
from validation.verdict.quantities import (
    ANGLES,
    IS_PRIMARY,
    QUANTITIES,
    branch_mask,
    branch_of,
    event_values,
    phase_masks,
)

DRAWS = 199  # ranks 5 and 195 hold 95 % exactly
OWN_DRAWS = 20  # of each trial's own errors, beside the common ones: choice
MOST_SAMPLES = 400  # of a curve of errors: choice, a window of 0.8 s in steps of 2 ms
INPUTS = (
    "force gain",
    "force level",
    "force delay",
    *(f"scale of the {name} sensor" for name in ENCODER_CHANNELS),
    *(f"offset of the {name} sensor" for name in ENCODER_CHANNELS),
    "film clock",
    *(f"{name} on film" for name in FILM_CHANNELS),
    "level of the hammer at rest",
    "level of the key at rest",
    *RULERS,
)
"""Names of `ErrorSample.inputs`; parameters of the action are what these leave."""


@dataclass(frozen=True)
class TrialErrors:
    """One trial: errors (V,), samples that each angle is a mean of, measured travel and events, branch of its motion.

    ``known``: bits of the branch that its usable encoders tell.
    """

    errors: Array
    masks: Mapping[str, NDArray[np.bool_]]
    travel: Mapping[str, float]
    values: Array
    branch: int
    known: int


@dataclass(frozen=True)
class Condition:
    """Trials of one condition, on the branch that most of them take, and what was measured in them."""

    trials: tuple[int, ...]
    branch: int
    known: int  # bits of the branch that the drawn trial's encoders tell
    travel: Mapping[str, float]  # range of each channel in the window, rad, mean over trials
    values: Array  # (Q,) events, mean over trials, NaN for angles
    representative: int  # number of the trial drawn


@dataclass(frozen=True)
class SessionErrors:
    """Comparison errors of a session: of each of its conditions `QUANTITIES`, one condition after the other."""

    sample: ErrorSample
    conditions: tuple[Condition, ...]
    # numbers of the trials on another branch than their condition's, with their branch and its known bits
    other_branch: Mapping[int, tuple[int, int]]
    failed: int  # draws that could not be run
    # time_s, curves: (n,) and (N, n, 5) errors of the first representative over time, rad; of those that could be run
    time_s: Array
    curves: NDArray[np.float32]
    changed: Sequence[Mapping[str, float]]  # parameters of the action in each draw

    @property
    def trials(self) -> tuple[int, ...]:
        return tuple(sorted(number for condition in self.conditions for number in condition.trials))


def errors_of_trials(
    predicted: PredictedSession, traces: SessionTraces, events: SessionEvents, tested: ModelUnderTest
) -> dict[int, TrialErrors]:
    """Errors of every trial, by number."""
    return {m.number: _errors_of_trial(m, traces, events, tested) for m in predicted.trials}


def select_usable_errors(
    found: Mapping[int, TrialErrors], without: Collection[tuple[int, str]] = ()
) -> dict[int, TrialErrors]:
    """Errors, by trial number, of the trials with at least one usable encoder; values that need a channel of the pairs
    (trial, channel) ``without`` are NaN and do not count for the branch of the motion."""
    out = {}
    for number, one in found.items():
        lost = {name for name in (*ENCODER_CHANNELS, *FILM_CHANNELS) if (number, name) in without}
        if not lost.issuperset(ENCODER_CHANNELS):
            out[number] = _drop_channels(one, lost) if lost else one
    return out


def _drop_channels(one: TrialErrors, lost: Collection[str]) -> TrialErrors:
    """Copy of a trial's errors in which angles of the channels ``lost``, and events that need them, are NaN, and in
    which only the other encoders count for the branch."""
    errors, values = one.errors.copy(), one.values.copy()
    of_events = QUANTITIES[len(ANGLES) :]
    errors[: len(ANGLES)][[q.channel in lost for q in ANGLES]] = np.nan
    gone = [any(body in lost for body in q.bodies) for q in of_events]
    errors[len(ANGLES) :][gone] = values[gone] = np.nan
    kept = {q.name for q in ANGLES if q.channel not in lost}
    known = branch_mask([name for name in ENCODER_CHANNELS if name not in lost])
    return TrialErrors(
        errors,
        {name: mask for name, mask in one.masks.items() if name in kept},
        {name: travel for name, travel in one.travel.items() if name not in lost},
        values,
        one.branch & known,
        known,
    )


def _errors_of_trial(
    m: MeasuredTrial, traces: SessionTraces, events: SessionEvents, tested: ModelUnderTest
) -> TrialErrors:
    """Errors, model − trial, of `QUANTITIES` in a trial, NaN of channels that it lacks and of missing events; with them
    the samples that each angle is a mean of, measured travel and events, and the branch of the motion."""
    frame, own = traces.encoder[m.number], events.trial[m.number]
    phases = phase_masks(m.time_s, own, traces.window)
    errors, masks, travel = np.full(len(QUANTITIES), np.nan), {}, {}
    for k, q in enumerate(ANGLES):
        source = frame if q.channel in ENCODER_CHANNELS else traces.film.get(m.number)
        if source is None or q.channel in set(ENCODER_CHANNELS) - set(m.channels):
            continue
        measured, predicted = (
            select_scored_angles(source, q.channel),
            source[f"{q.channel}_predicted_rad"].to_numpy(dtype=float),
        )
        if q.channel in FILM_CHANNELS:
            at = source["time_s"].to_numpy()
            measured, predicted = (np.interp(m.time_s, at, v, left=np.nan, right=np.nan) for v in (measured, predicted))
        mask = phases[q.phase] & np.isfinite(measured) & np.isfinite(predicted)
        inside = traces.window.mask(m.time_s) & np.isfinite(measured)
        if mask.any():
            masks[q.name], errors[k] = mask, float((predicted - measured)[mask].mean())
            travel[q.channel] = float(np.ptp(measured[inside]))
    geometry = tested.geometry_of_trial(m)
    angle = {i: frame[f"{name}_predicted_rad"].to_numpy(dtype=float) for i, name in enumerate(("key", "whippen"))}
    angle[4] = frame["hammer_predicted_rad"].to_numpy(dtype=float)
    predicted_motion = replace(m.motion, hammer_height_m=geometry.hammer_height_m(geometry.absolute(angle)))
    values = event_values(m.motion, own)
    errors[len(ANGLES) :] = event_values(predicted_motion, events.model[m.number]) - values
    known = branch_mask(ENCODER_CHANNELS)
    return TrialErrors(errors, masks, travel, values, branch_of(own) & known, known)


def session_errors(
    predicted: PredictedSession,
    tested: ModelUnderTest,
    found: Mapping[int, TrialErrors],
    conditions: Sequence[Collection[int]] = (),
    u_rest_level_m: float = 0.0,
) -> SessionErrors | None:
    """Errors ``found``, by trial number, averaged over each of the ``conditions`` on its usual branch, and draws of
    them if the model were right; ``u_rest_level_m``: u of heights at rest. Simulates a trial a condition, unless
    stored. None without trials.

    Parameters
    ----------
    found : errors of the usable trials, as of `select_usable_errors`
    conditions : sequence of collections of trial numbers, where the session holds several
    u_rest_level_m : standard uncertainty of hammer height and key dip at rest, m
    """
    usable = [m for m in predicted.trials if m.number in found]
    if not usable:
        return None
    groups, other = _select_majority_branch(usable, found, conditions)
    seed = session_seed(predicted.trials)
    draws = joint_draws(tested.action, seed, DRAWS, parameters=True)
    of_group = []
    for group in groups:
        most = max(found[m.number].known for m in group)
        whole = [m for m in group if found[m.number].known == most]
        m = select_representative([m for m in whole if m.film is not None] or whole)
        drawing = _TrialDrawing(tested, m, found[m.number].masks, draws, own_draws(seed, OWN_DRAWS), u_rest_level_m)
        of_group.append((m, drawing.load_or_run()))
    ran = np.all([np.isfinite(one.common).any(axis=1) for _, one in of_group], axis=0)
    means = [_means(np.array([found[m.number].errors for m in group])) for group in groups]
    sample = ErrorSample(
        found=np.concatenate([mean for mean, _, _ in means]),
        n_trials=np.concatenate([count for _, count, _ in means]),
        residuals=_block_diagonal([residuals for _, _, residuals in means]),
        common=np.concatenate([one.common[ran] for _, one in of_group], axis=1),
        own=_block_diagonal([one.own for _, one in of_group]),
        condition=np.repeat(np.arange(len(groups)), len(QUANTITIES)),
        branch=np.column_stack([(one.branch & found[m.number].known)[ran] for m, one in of_group]),
        branch_found=np.array([found[m.number].branch for m, _ in of_group]),
        inputs=np.array([_inputs(d, any(m.sensors is not None for m in usable)) for d in draws])[ran],
        floor=np.tile(_floors(usable), len(groups)),
        primary=np.tile(IS_PRIMARY, len(groups)),
    )
    first, of_first = of_group[0]
    return SessionErrors(
        sample=sample,
        conditions=tuple(_condition(group, m, found) for group, (m, _) in zip(groups, of_group, strict=True)),
        other_branch=other,
        failed=int(len(draws) - ran.sum()),
        time_s=first.time_s[_sparse(first.time_s.size)],
        curves=of_first.curves[ran],
        changed=[d.changed for d, one in zip(draws, ran, strict=True) if one],
    )


def _condition(group: Sequence[MeasuredTrial], drawn: MeasuredTrial, found: Mapping[int, TrialErrors]) -> Condition:
    numbers = tuple(sorted(m.number for m in group))
    travels = {name: [t for n in numbers if (t := found[n].travel.get(name)) is not None] for name in CHANNELS}
    travel = {name: float(np.mean(t)) for name, t in travels.items() if t}
    values = _means(np.array([found[n].values for n in numbers]))[0]
    return Condition(numbers, found[drawn.number].branch, found[drawn.number].known, travel, values, drawn.number)


def _block_diagonal(blocks: Sequence[Array]) -> Array:
    """Blocks along the diagonal, NaN elsewhere: trials of one condition say nothing of the scatter of another."""
    rows, columns = (np.cumsum([0, *(block.shape[axis] for block in blocks)]) for axis in (0, 1))
    out = np.full((rows[-1], columns[-1]), np.nan)
    for k, block in enumerate(blocks):
        out[rows[k] : rows[k + 1], columns[k] : columns[k + 1]] = block
    return out


def _select_majority_branch(
    usable: Sequence[MeasuredTrial], found: Mapping[int, TrialErrors], conditions: Sequence[Collection[int]]
) -> tuple[list[list[MeasuredTrial]], dict[int, tuple[int, int]]]:
    """Trials of each condition whose events follow its most frequent branch (a condition without trials is left out),
    and for each other trial, by number, its branch and the bits of it that its encoders tell; ``found``: errors by
    trial number."""
    groups: list[list[MeasuredTrial]] = []
    other: dict[int, tuple[int, int]] = {}
    for numbers in conditions or [[m.number for m in usable]]:
        members = [m for m in usable if m.number in numbers]
        if not members:
            continue
        whole = max(found[m.number].known for m in members)
        every = [found[m.number].branch for m in members if found[m.number].known == whole]
        most = Counter(every).most_common(1)[0][0]
        same = {m.number: found[m.number].branch == most & found[m.number].known for m in members}
        groups.append([m for m in members if same[m.number]])
        other |= {m.number: (found[m.number].branch, found[m.number].known) for m in members if not same[m.number]}
    return groups, other


def _means(errors: Array) -> tuple[Array, NDArray[np.int64], Array]:
    """Mean (V,) over trials, number of trials, and residuals (n, V), skipping NaN."""
    known = np.isfinite(errors)
    count = known.sum(axis=0)
    mean = np.where(known, errors, 0.0).sum(axis=0) / np.where(count > 0, count, np.nan)
    return mean, count, errors - mean


@dataclass(frozen=True)
class _TrialDraws:
    """Errors of one trial as drawn, (N, V) and (K, V), NaN where a draw cannot be run; branches; errors over time."""

    common: Array
    own: Array
    branch: NDArray[np.int64]
    curves: NDArray[np.float32]


@dataclass(frozen=True)
class _TrialDrawing:
    """What the draws of one trial are made from: of what is common to all trials, and of what it has for itself."""

    tested: ModelUnderTest
    m: MeasuredTrial
    masks: Mapping[str, NDArray[np.bool_]]
    common: Sequence[JointDraw]
    own: Sequence[JointDraw]
    u_rest_level_m: float

    def load_or_run(self) -> _TrialDraws:
        """Draws of the errors of one trial: read from the store where nothing they depend on has changed, else run and
        stored."""
        m, n = self.m, len(self.common)
        sensors = (m.u_rad, m.resolution_rad, m.scale_relative_u, m.time_s, m.quiet.stop, self.u_rest_level_m)
        # one array of all parameters: hashing them one by one costs a twentieth of a comparison
        values = np.array([list(draw.changed.values()) for draw in self.common])
        names = [list(draw.changed) for draw in self.common[:1]]
        draws = names, values, [replace(draw, changed={}) for draw in (*self.common, *self.own)]
        key = (m.change_rad[:, 0], m.sensors and m.sensors.calibration) if m.driven_by_key else ()
        known = self.tested.identity, draws, m.number, m.force, m.film, sensors, self.masks, key
        stored = self.tested.store.value("error draws", known, self._run)
        n_samples = m.time_s[_sparse(m.time_s.size)].size
        values = np.frombuffer(base64.b64decode(stored["values"])).reshape(n + len(self.own) - 1, len(QUANTITIES))
        curves = np.full((n, n_samples, len(CHANNELS)), np.nan, dtype=np.float32)
        for name, text in stored["curves"].items():
            curves[..., CHANNELS.index(name)] = np.frombuffer(base64.b64decode(text), np.float32).reshape(n, n_samples)
        return _TrialDraws(values[:n], values[n:], np.array(stored["branch"], dtype=np.int64), curves)

    def _run(self) -> dict[str, Any]:
        """Errors (``values``), branches (``branch``) and errors over time (``curves``, by channel) of the trial in
        every draw, as the store keeps them, arrays in base64; simulates each draw."""
        tested, m = self.tested, self.m
        every = [*(replace(d, has_own_errors=False) for d in self.common), *self.own[1:]]
        n, sparse = len(self.common), _sparse(m.time_s.size)
        values = np.full((len(every), len(QUANTITIES)), np.nan)
        branch = np.full(n, -1, dtype=np.int64)
        curves = np.full((n, m.time_s[sparse].size, len(CHANNELS)), np.nan, dtype=np.float32)
        (right,) = run_draws(tested, [(m, m.time_s)], self.own[:1], lambda _, read: read)[0]
        if right is not None:
            at_right = self._read_events(self.own[0], right)[0]
            (runs,) = run_draws(tested, [(m, m.time_s)], every, lambda _, read: read)
            for k, read in enumerate(runs):
                if read is None:
                    continue
                apart = right - read
                values[k, : len(ANGLES)] = self._angle_means(apart)
                at_draw, its_branch = self._read_events(every[k], read)
                values[k, len(ANGLES) :] = at_right - at_draw
                if k < n:
                    branch[k], curves[k] = its_branch, apart[sparse]
        measured = [name for i, name in enumerate(CHANNELS) if np.isfinite(curves[..., i]).any()]
        return {
            "values": base64.b64encode(values.tobytes()).decode("ascii"),
            "branch": branch.tolist(),
            "curves": {
                name: base64.b64encode(curves[..., CHANNELS.index(name)].tobytes()).decode("ascii") for name in measured
            },
        }

    def _angle_means(self, apart: Array) -> Array:
        """Means (k,), rad, one for each of `ANGLES`, of the differences ``apart`` (n, channels), rad, over that angle's
        samples; NaN where the trial does not have it."""
        out = np.full(len(ANGLES), np.nan)
        for k, q in enumerate(ANGLES):
            if q.name in self.masks:
                part = apart[self.masks[q.name], CHANNELS.index(q.channel)]
                part = part[np.isfinite(part)]
                out[k] = part.mean() if part.size else np.nan
        return out

    def _read_events(self, draw: JointDraw, read: Array) -> tuple[Array, int]:
        """Event values, as of `event_values`, and number of the branch of the motion, that readings ``read`` (n,
        channels) of the trial give, rad since rest, with the levels at rest moved as in ``draw``."""
        m = self.m
        motion = m.read_motion(m.time_s, read[:, : len(ENCODER_CHANNELS)])
        hammer, key = (self.u_rest_level_m * z for z in draw.z_levels)
        motion = replace(
            motion,
            hammer_height_m=motion.hammer_height_m + hammer,
            hammer_way_m=motion.hammer_way_m + hammer,
            key_dip_m=motion.key_dip_m + key,
        )
        events = find_events(motion, m.quiet.stop, read_level)
        return event_values(motion, events), branch_of(events)


def _sparse(n: int) -> slice:
    """Samples at which errors over time are kept."""
    return slice(None, None, max(1, n // MOST_SAMPLES))


def _inputs(draw: JointDraw, has_rulers: bool) -> Array:
    n = len(ENCODER_CHANNELS)
    scales, offsets = draw.z_scale, draw.z_change
    force = draw.z_gain, draw.z_preload, draw.z_delay
    ruler = draw.z_ruler if has_rulers else (0.0,) * len(RULERS)
    return np.array([*force, *scales[:n], *offsets[:n], scales[n], *offsets[n:], *draw.z_levels, *ruler])


EVENT_FLOOR = 1e-7  # s, m, m/s: far below any event's uncertainty


def _floors(trials: Sequence[MeasuredTrial]) -> Array:
    """Least scale of each quantity: of an encoder's angle one count, rectangular."""
    counts = np.mean([np.abs(m.resolution_rad) for m in trials], axis=0) / np.sqrt(12.0)
    of_channel = dict(zip(ENCODER_CHANNELS, counts, strict=True))
    return np.array([float(of_channel.get(q.channel, 0.0)) or EVENT_FLOOR for q in QUANTITIES])
