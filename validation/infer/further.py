"""What to record next: which further trials, or which sensor known better, would shrink which interval.

In: an identification, strokes that could be played (`list_candidate_strokes`). Out: `Prospect`, ranked, and a trial
plan for ``record --plan``.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from model.errors import ModelError
from rig import (
    PredictedBlow,
    Profile,
    RigConfig,
    RigError,
    dry_run,
    load_plan,
    load_profile,
    motor_command,
    parse_profile,
)
from rig.configuration.profile import built_in_profiles
from rig.session.force_correction import Quiet
from validation.conventions import Array
from validation.errors import ValidationInputError
from validation.infer.blocks import INSTRUMENT, Block, make_blocks, rows
from validation.infer.channels import FORCE_DELAY, FORCE_GAIN, FORCE_LEVEL, ZERO
from validation.infer.estimates import NORMAL
from validation.infer.fit import LAST_ROUNDS, Fitted
from validation.infer.noise import (
    FAMILIES,
    FLOOR,
    NOT_SEEN,
    SCALES_S,
    Marginal,
    law_columns,
    own_parts,
    scores,
    select_noise_model,
)
from validation.infer.observations import CHANNEL_NAMES, ObservedTrial, observe
from validation.infer.problem import Problem
from validation.infer.response import ModelResponse, Response
from validation.measurement.trial import MeasuredTrial
from validation.report.files import check_target, write_files

LEVELS = (0.7, 1.0, 1.4)  # times a recorded stroke's force: half the energy, the same, twice
REST_S = 0.1  # of rest before the blow
STARTS = 0.01  # of the largest change of the force


@dataclass(frozen=True)
class Candidate:
    """A stroke that could be recorded."""

    name: str  # what it is, in words
    trial: ObservedTrial  # as it would be observed
    profile: Profile | None = None  # what the motor would play; None for more of a session's own


def list_candidate_strokes(
    config: RigConfig,
    predict: Callable[[Profile], PredictedBlow],
    like: MeasuredTrial,
    phases: int,
    levels: Sequence[float] = LEVELS,
) -> tuple[list[Candidate], list[str]]:
    """Candidate strokes: each shipped profile times each factor in ``levels``, its blow predicted by ``predict`` and
    observed at ``phases`` times by the sensors of trial ``like``; and a line ``name: reason`` for each that the bench's
    limits refuse.

    What the bench's limits forbid is left out, with the reason. The blow is predicted by the identified action on the
    arm of the rig file (a callable, as for the rig's dry run), and read as the bench's sensors would read it, without
    noise.

    Parameters
    ----------
    predict : the blow that a profile gives
    like : a trial of the bench; sensors and preload are taken from it
    phases : how many times of a trial are compared
    levels : factors of the force
    """
    found: list[Candidate] = []
    refused: list[str] = []
    for name in built_in_profiles():
        for level in levels:
            profile = scale_profile_force(load_profile(name), level)
            kept: list[PredictedBlow] = []

            def remember(one: Profile, kept: list[PredictedBlow] = kept) -> PredictedBlow:
                kept.append(predict(one))
                return kept[0]

            try:
                motor_command(profile, config)
                dry_run(profile, config, remember)
                (trial,) = observe(profile.name, 0, [make_measured_trial(kept[0], like)], phases)
            except (RigError, ValidationInputError) as error:
                refused.append(f"{profile.name}: {error}")
                continue
            found.append(Candidate(profile.name, trial, profile))
    return found, refused


def scale_profile_force(profile: Profile, level: float) -> Profile:
    """The profile with its force multiplied by ``level`` and the level in its name; itself at level 1."""
    if level == 1.0:
        return profile
    points = ", ".join(
        f"{{ time_s = {float(t)!r}, force_n = {float(level * f)!r} }}"
        for t, f in zip(profile.time_s, profile.force_n, strict=True)
    )
    name = f"{profile.name} x {level:g}"
    text = f'name = "{name}"\ninterpolation = "{profile.interpolation}"\npoints = [{points}]\n'
    return parse_profile(text, name)


def make_measured_trial(blow: PredictedBlow, like: MeasuredTrial) -> MeasuredTrial:
    """Trial that the bench would measure of the predicted ``blow``, without noise: 0.1 s of rest, then its force and
    angles; sensors, uncertainties and preload are those of trial ``like``. It has number 0 and no film."""
    step = float(np.median(np.diff(blow.time_s)))
    rest = int(np.ceil(REST_S / step))
    time = np.concatenate([blow.time_s[0] + step * np.arange(-rest, 0), blow.time_s])
    force = np.concatenate([np.zeros(rest), blow.force_n - blow.force_n[0]]) + like.force.preload_n
    change = np.vstack([np.zeros((rest, blow.angle_rad.shape[1])), blow.angle_rad - blow.angle_rad[0]])
    away = np.abs(force - force[0])
    onset = int(np.argmax(away > STARTS * away.max()))
    return replace(
        like,
        number=0,
        time_s=time,
        raw_force_n=force,
        force=replace(like.force, time_s=time, force_n=force, u_force_n=np.zeros(time.size)),
        quiet=Quiet(onset, float(time[0]), float(time[onset]), float(time[onset])),
        change_rad=change,
        film=None,
        seal="",
    )


Play = Callable[[Sequence[Array]], Sequence[Array | None]]
"""Curves (m, c) of the stroke at points (p + h,): everything that moves, then fixed laws; None where it cannot run."""
SEED = 163


def rehearse_stroke(fitted: Fitted, planned: Marginal, block: Block, play: Play, trials: int) -> Marginal | None:
    """Marginal model of the fit with ``trials`` simulated trials of one stroke added and variance components learnt
    from all; ``block``: its linear model, ``play`` runs it, ``planned``: the model before learning. None where a run
    fails.

    The Fisher information takes a stroke to answer a scatter of its laws linearly. Near a fork of its motion it does
    not: what is not linear is taken for something the model lacks, and widens every interval. So the stroke is played
    with laws that scatter as learnt, read with the sensors' errors and noise, put beside the strokes at hand, and the
    sizes of noise are learnt again from all of them, on the linear model.

    Parameters
    ----------
    fitted : the identification
    planned : the same with the new trials, sizes as learnt so far; their session is its last
    block : linear model of one such trial
    play : what the model does with other laws
    trials : how many
    """
    rng, sizes = np.random.default_rng(SEED), planned.sizes
    new = replace(block, session=len(sizes.common) - 1)
    here = np.concatenate([fitted.z, np.zeros(len(sizes.families) - fitted.z.size)])
    drawn = rng.standard_normal((trials, here.size))
    away = sizes.scatter * drawn / np.sqrt(np.mean(drawn**2, axis=0))  # as large as said: a rehearsal is no die
    curves = [None if c is None else rows(np.asarray(c)) for c in play([here, *(here + step for step in away)])]
    still, moved = curves[0], [c for c in curves[1:] if c is not None]
    if still is None or len(moved) < trials:
        return None
    lacking, own = _discrepancy_columns(planned, new), own_parts(new, sizes)
    wander = (own.columns * np.exp(sizes.log())[own.component])[:, own.component >= len(FAMILIES)]
    steady = np.hstack([new.moved, new.instrument]) @ fitted.marginal.mean(fitted.linear)[: planned.shared]
    steady = steady - still + lacking @ rng.standard_normal(lacking.shape[1])
    columns = np.hstack([wander, new.own, np.diag(np.sqrt(new.white))])
    linear = [c + steady + columns @ rng.standard_normal(columns.shape[1]) for c in moved]
    blocks = [*fitted.marginal.blocks, *trials * [new]]
    return select_noise_model(blocks, [*fitted.linear, *linear], sizes, LAST_ROUNDS, anew=False)


def _discrepancy_columns(planned: Marginal, new: Block) -> Array:
    """Columns (n, k), rad, of the discrepancy in a trial of the new session, whose linear model is ``new``: scaled to
    the standard deviations in ``planned``, less the floor, which no stroke has shown."""
    sizes, part = planned.sizes, planned.parts[0][new.session]
    common = sizes.common[new.session].copy()
    smooth = slice(0, len(SCALES_S) * sizes.channels)
    common[smooth] = np.sqrt(np.maximum(common[smooth] ** 2 - FLOOR**2 / len(SCALES_S), 0.0))
    size = np.exp(sizes.log())
    first = size.size - sizes.common[new.session :].size
    size[first : first + common.size] = common
    columns, laws = part.columns * size[part.component], law_columns(new, sizes)
    return np.asarray(columns[laws.shape[1] :] + laws @ columns[: laws.shape[1]])


TRIALS = 5  # choice: strokes of a kind to be recorded, as a plan's default
REHEARSED, MOST_REHEARSED = 3, 8  # strokes that are rehearsed: at least; until the best of all is one of them, at most
OF_ANOTHER_KIND = 0.2
"""Standard deviation of the logarithm of a shrink by a kind of stroke not played so far, beside all that is computed:
measured (`python -m benchmarks record_next_sizes`, seed 1, the first six experiments of seed 2)."""
HALF_KNOWN = 0.5  # of the prior standard deviation: what one more calibration is taken to leave
SENSORS = {
    "load cell's gain": (FORCE_GAIN,),
    "load cell's preload": (FORCE_LEVEL,),
    "load cell's delay": (FORCE_DELAY,),
    "key encoder": ("key encoder scale", "key encoder zero"),
    "whippen encoder": ("whippen encoder scale", "whippen encoder zero"),
    "hammer encoder": ("hammer encoder scale", "hammer encoder zero"),
}
Respond = Callable[[Sequence[ObservedTrial]], Response]


@dataclass(frozen=True)
class Prospect:
    """One thing that could be done next."""

    name: str  # in words
    shrink: Mapping[str, float]  # name of a parameter -> its u after, divided by its u now
    candidate: Candidate | None = None  # the stroke to record; None for a sensor
    trials: int = 0  # how many of it
    # name of a parameter -> standard deviation of the logarithm of its shrink, from what the new strokes may teach
    # about the sizes of noise, from how far the rehearsal is from the Fisher information, and `OF_ANOTHER_KIND`; empty
    # where the stroke was not rehearsed
    u_sizes: Mapping[str, float] = field(default_factory=dict)
    # the shrink by the Fisher information alone; empty where the stroke was not rehearsed
    fisher: Mapping[str, float] = field(default_factory=dict)

    def range(self, name: str) -> tuple[float, float]:
        """95 % interval of a parameter's shrink."""
        far = float(np.exp(NORMAL * self.u_sizes.get(name, 0.0)))
        return self.shrink[name] / far, self.shrink[name] * far

    @property
    def words(self) -> str:
        """What could be done next: so many trials of a stroke, so many more of a session, a sensor."""
        if self.candidate is None:
            return self.name
        return (
            f"{self.trials} {self.name}" if self.candidate.profile is None else f"{self.trials} trials of {self.name}"
        )

    @property
    def mean(self) -> float:
        """Geometric mean of the shrinks: what the prospects are ranked by, the smallest first."""
        return float(np.exp(np.mean(np.log(list(self.shrink.values())))))


def prospects(
    problem: Problem,
    fitted: Fitted,
    candidates: Sequence[Candidate],
    trials: int = TRIALS,
    respond: Respond | None = None,
) -> tuple[list[Prospect], list[str]]:
    """Predicted u after over u now of each parameter (`Prospect`), for ``trials`` more of each candidate and of each
    session's stroke, and for each sensor's u halved, the best first; and a line for each candidate that the model
    cannot run.

    From the Fisher information at the identified values: the covariance of the fit with the columns of the new trials
    beside those it has (`noise.Marginal`), sizes of noise as learnt. A further session has a discrepancy of its own, as
    large as those learnt so far. The best strokes are played by the model (`rehearsal`), for which the sizes are learnt
    again. How far these may yet move is told as an interval (`u_from_noise_sizes`); how far the values move it cannot
    know: it is a prediction of u, not of the value.

    Parameters
    ----------
    problem, fitted : the identification
    candidates : strokes that could be recorded; more of each session's own kind are added
    trials : how many of each
    respond : what makes the model's response to some trials; by default the project's model
    """
    held = problem.unknowns.held[: problem.held[0].shape[2] if problem.held else 0]
    make = respond or (lambda some: ModelResponse(problem.action, (*problem.unknowns.moved, *held), some))
    names = [p.name for p in problem.unknowns.asked]
    found: list[Prospect] = []
    made: dict[str, Block] = {}
    again: set[str] = set()
    refused: list[str] = []

    def ratio(marginal: Marginal) -> dict[str, float]:
        now, then = (np.sqrt(np.diag(m.covariance)[: len(names)]) for m in (fitted.marginal, marginal))
        return {name: float(x) for name, x in zip(names, then / now, strict=True)}

    blocks = fitted.marginal.blocks
    own = {b.session: (t, b) for t, b in zip(problem.trials[::-1], blocks[::-1], strict=True)}
    for t, b in own.values():
        more = Candidate(f"more of {t.label.rpartition(', trial')[0]}", t)
        made[more.name] = b
        again.add(more.name)
        found.append(Prospect(more.name, ratio(add_trials(fitted, b, trials)), more, trials))
    for one in candidates:
        try:
            block = block_of(problem, fitted.z, one.trial, make)
        except ModelError as error:
            refused.append(f"{one.name}: {error}")
            continue
        made[one.name] = block
        found.append(Prospect(one.name, ratio(add_trials(fitted, block, trials)), one, trials))
    for sensor, columns in SENSORS.items():
        found.append(Prospect(f"{sensor} known twice as well", ratio(_halve_sensor_u(problem, fitted, columns))))

    def told(p: Prospect) -> Prospect:
        """A stroke as it is after a rehearsal, with limits."""
        assert p.candidate is not None
        block = made[p.name]
        planned = add_trials(fitted, block, trials)
        then = rehearse_stroke(fitted, planned, block, _player(make([p.candidate.trial])), trials) or planned
        shrink = ratio(then)
        apart = [np.log(shrink[name] / p.shrink[name]) for name in names]
        other = 0.0 if p.name in again else OF_ANOTHER_KIND
        u = np.sqrt(u_from_noise_sizes(fitted, then)[: len(names)] ** 2 + np.square(apart) + other**2)
        return replace(p, shrink=shrink, fisher=p.shrink, u_sizes=dict(zip(names, u.tolist(), strict=True)))

    return _add_best_rehearsed(found, told), refused


def _add_best_rehearsed(found: Sequence[Prospect], rehearse: Callable[[Prospect], Prospect]) -> list[Prospect]:
    """Prospects, the best (least mean shrink) first; the best strokes are replaced by ``rehearse(prospect)`` in turn,
    at least `REHEARSED` and at most `MOST_REHEARSED`, until the best stroke of all is a rehearsed one."""
    ranked = sorted(found, key=lambda p: p.mean)
    done = 0
    while True:
        strokes = [i for i, p in enumerate(ranked) if p.candidate is not None]
        waiting = [i for i in strokes if not ranked[i].u_sizes]
        enough = done >= REHEARSED and bool(ranked[strokes[0]].u_sizes)
        if not waiting or enough or done >= MOST_REHEARSED:
            return ranked
        ranked[waiting[0]] = rehearse(ranked[waiting[0]])
        ranked.sort(key=lambda p: p.mean)
        done += 1


def _player(response: Response) -> Play:
    """What the model does in one stroke, with what moves and fixed laws elsewhere."""
    return lambda points: [None if curves is None else curves[0] for curves in response.curves(points)]


def u_from_noise_sizes(fitted: Fitted, marginal: Marginal) -> Array:
    """Standard deviation (p,) of the logarithm of each parameter's u in ``marginal``, the fit with new strokes added,
    from how far these may still change the variance components.

    What the strokes so far do not know of the sizes, less what will still not be known, is how far they may move; what
    that does to a u is the size's share in its variance.
    """
    sizes, now, then = marginal.sizes, scores(fitted.marginal).information, scores(marginal)
    old = fitted.marginal.sizes
    f, c, k = len(sizes.by_family), sizes.channels, sizes.common.shape[1]
    n, s = len(sizes.own), len(old.own)
    place = np.concatenate(
        [np.arange(f), f + np.arange(s * c), f + n * c + np.arange(s * k)]  # of families, own, common of old sessions
    )
    known = np.zeros_like(then.information)
    known[np.ix_(place, place)] = now
    believed = np.diag(1.0 / sizes.log_prior_moments()[1] ** 2)
    moves = np.linalg.inv(known + believed) - np.linalg.inv(then.information + believed)
    return np.asarray(np.sqrt(np.maximum(np.einsum("pi,ij,pj->p", then.shares, moves, then.shares), 0.0)))


def block_of(problem: Problem, z: Array, trial: ObservedTrial, respond: Respond) -> Block:
    """The linear model of a trial that has not been recorded."""
    p, every = z.size, problem.families.size
    (found,) = respond([trial]).jacobian(z, range(every), driven=True)
    columns, held, force = np.split(found, [p, every], axis=2)
    return make_blocks([trial], [columns], [force], problem.laws[:p], (held,))[0]


def add_trials(fitted: Fitted, block: Block, trials: int) -> Marginal:
    """Marginal model of the fit with ``trials`` more trials like ``block``, in a further session."""
    sizes, new = fitted.marginal.sizes, len(fitted.marginal.sizes.common)
    more = replace(sizes, own=_append_typical_sizes(sizes.own), common=_append_typical_sizes(sizes.common))
    return Marginal([*fitted.marginal.blocks, *trials * [replace(block, session=new)]], more)


def _append_typical_sizes(of_sessions: Array) -> Array:
    """Sizes by session and channel with a row for one more session: the root mean square of those that have one."""
    there = np.maximum((of_sessions > NOT_SEEN).sum(axis=0), 1)
    return np.vstack([of_sessions, np.sqrt((of_sessions**2).sum(axis=0) / there)])


def _halve_sensor_u(problem: Problem, fitted: Fitted, columns: Sequence[str]) -> Marginal:
    """The model of the fit with errors of sensors half as large: of the force, which it moves, and of encoders."""
    moved = np.array([HALF_KNOWN if p.name in columns else 1.0 for p in problem.unknowns.moved])
    blocks = []
    for trial, b in zip(problem.trials, fitted.marginal.blocks, strict=True):
        instrument = np.array([remaining_u(trial, name) if name in columns else 1.0 for name in INSTRUMENT])
        blocks.append(replace(b, moved=b.moved * moved, instrument=b.instrument * instrument))
    return Marginal(blocks, fitted.marginal.sizes)


def remaining_u(trial: ObservedTrial, name: str) -> float:
    """Share of the standard uncertainty of a channel's error (of `INSTRUMENT`) that one more calibration leaves: of a
    zero its rounding, too."""
    c = next((k for k, c in enumerate(trial.channels) if name == f"{CHANNEL_NAMES[c]} {ZERO}"), -1)
    if c < 0 or trial.u_steady_rad[c] == 0.0:
        return HALF_KNOWN
    calibrated, steady = float(trial.u_calibrated_rad[c]), float(trial.u_steady_rad[c])
    return math.sqrt(steady**2 - (1.0 - HALF_KNOWN**2) * calibrated**2) / steady


SHOWN = 8  # rows of a figure, on one page


def best_stroke(ranked: Sequence[Prospect]) -> Prospect | None:
    """The best of those that are strokes of a profile; None where the bench allows or the model predicts none."""
    strokes = (p for p in ranked if p.candidate is not None and p.candidate.profile is not None)
    return next(strokes, None)


def write_plan(ranked: Sequence[Prospect], path: str | Path, doubts: Sequence[str] = ()) -> dict[str, Path]:
    """Write the best stroke as a trial plan (TOML), with its profile beside it unless that ships; files of these names
    are replaced, all or none. Return name -> path; input error where no stroke of a profile is ranked.

    Parameters
    ----------
    ranked : what `validation.infer.further.prospects` found
    path : plan file to write, ending in .toml
    doubts : why the numbers may not come true; said in the file

    Returns
    -------
    dict
        Relative name -> path of what was written.

    Raises
    ------
    ValidationInputError
        Another ending, a folder that is not there, or nothing to recommend.
    """
    target = check_target(path)
    best = best_stroke(ranked)
    profile = None if best is None or best.candidate is None else best.candidate.profile
    if best is None or profile is None:
        raise ValidationInputError(f"{target}: no profile can be recommended, so that there is no plan to write")
    condition = re.sub(r"[^A-Za-z0-9.-]+", "_", profile.name).strip("_.-")
    built_in = profile.name in built_in_profiles()
    named = profile.name if built_in else f"{target.stem}_{condition}.toml"
    limits = {name: best.range(name) for name in best.shrink}
    lines = [
        "# What to record next, by pianorig identify: u of each parameter after, divided by u now, as predicted at the",
        "# identified values, and 95 % limits: the strokes teach about the noise, too.",
        *(f"# In doubt: {line}." for line in doubts),
        *(f"# {name}: {x:.2f} ({limits[name][0]:.2f} to {limits[name][1]:.2f})" for name, x in best.shrink.items()),
        "#",
        "# What else was looked at, geometric mean of the same:",
        *(f"# {p.mean:.2f}  {p.name}" for p in ranked[:SHOWN]),
        'schema = "piano-action-rig plan 1"',
        f'name = "record next: {profile.name}"',
        'order = "listed"',
        "[[conditions]]",
        f'name = "{condition}"',
        f'profile = "{named}"',
        f"repeats = {best.trials}",
    ]
    texts: dict[str, str | bytes] = {} if built_in else {named: profile.text}
    texts[target.name] = "\n".join(lines) + "\n"
    written = write_files(target.parent, texts)
    load_plan(target)  # what was written can be played
    return written
