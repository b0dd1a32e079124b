"""Identification on a session of positions: a set found on some strokes, left-out fits for the bands, and its file."""

from __future__ import annotations

import json
from collections.abc import Callable, Collection, Sequence
from dataclasses import asdict, dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

import model
from rig.atomic_write import write_text
from rig.session import Session
from validation.conventions import Array
from validation.errors import ValidationInputError
from validation.events.strikes import RELEASE, SLOW_M_PER_S, find_phases, find_stroke_events
from validation.measurement.positions import Stroke, measure_positions, smoothed
from validation.measurement.sample_fingerprints import are_same_samples
from validation.prediction.black_boxes import Example, fit_black_boxes
from validation.prediction.positions import FREE, NAMES, SENSORS, Mixture, Predict, of_model, of_null
from validation.statistics.bands import PredictedStroke, PredictionBand, estimate_spread, prediction_band
from validation.statistics.domain import extract_features

SCATTER = 0.05
"""What the model is expected to miss the hammer by, in rulers."""
INDEPENDENT = 60.0
APART_S, APART_M = 0.02, 0.02
"""Samples of the misfit are so far apart: in time, or the hammer in rulers."""
DIFFERENCE = 0.06
"""Step of a parameter for the slopes, in standard deviations of its prior: contacts make the misfit rough."""
SPEED_SCATTER = 0.03
"""What the model is expected to miss the speed before an impact by, a share of it."""
LIMIT = 4.0
"""Parameters stay within so many standard deviations of their priors."""
MOST_RUNS = 25


@dataclass(frozen=True, eq=False)
class Fit:
    """Parameters in standard deviations of their priors (p,), their covariance (p, p), and the misfit before and
    after."""

    z: Array
    covariance: Array
    cost_before: float
    cost: float
    runs: int


@lru_cache(maxsize=64)
def chosen_samples(stroke: Stroke) -> NDArray[np.int64]:
    """Samples of the misfit."""
    steady = smoothed(stroke.hammer.value_m, np.full(stroke.time_s.size, 2e-2 * stroke.hammer.travel_m), 4e-5)
    way = np.diff(stroke.time_s) / APART_S + np.abs(np.diff(steady)) / (APART_M * stroke.hammer.travel_m)
    length = np.concatenate([[0.0], np.cumsum(way)])
    return np.unique(np.searchsorted(length, np.arange(0.0, length[-1])))


@lru_cache(maxsize=64)
def measured_speeds(stroke: Stroke) -> Array:
    """Speed before the impact of each strike, m/s; NaN of a slow press, which strikes nothing."""
    return speeds_of(stroke, stroke.hammer.value_m)


def speeds_of(stroke: Stroke, hammer_m: Array) -> Array:
    """Speed before the impact of each strike, m/s, of a hammer's displacement (n,), m; NaN of a slow press."""
    found = np.array([event["speed_m_per_s"] for event in find_stroke_events(stroke, hammer_m)])
    return np.where(found > SLOW_M_PER_S, found, np.nan)


def misfit(z: Array, strokes: Sequence[Stroke], predict: Predict) -> Array:
    """Residuals: one a parameter (its prior), then those of every stroke, of its samples and of its speeds."""
    parts = [z]
    for stroke in strokes:
        at, measured = chosen_samples(stroke), measured_speeds(stroke)
        try:
            hammer = predict(z, stroke, None)
        except model.ModelError:
            hammer = np.full(stroke.time_s.size, np.nan)
        error = (hammer - stroke.hammer.value_m)[at] / stroke.hammer.travel_m
        error = np.clip(np.nan_to_num(error, nan=1.0), -1.0, 1.0) / SCATTER
        parts.append(_robust(error) * np.sqrt(INDEPENDENT / at.size))
        strikes = np.isfinite(measured)
        speed = speeds_of(stroke, hammer)[strikes] if np.isfinite(hammer).all() else np.full(strikes.sum(), np.nan)
        parts.append(_robust(np.nan_to_num(speed / measured[strikes] - 1.0, nan=1.0) / SPEED_SCATTER))
    return np.concatenate(parts)


def _robust(error: Array) -> Array:
    """Pseudo-Huber: residuals whose squares grow like the errors where these are large."""
    return np.asarray(np.sign(error) * np.sqrt(2.0 * (np.sqrt(1.0 + error**2) - 1.0)))


def fit(
    strokes: Sequence[Stroke],
    predict: Predict,
    start: Array,
    *,
    runs: int = MOST_RUNS,
    say: Callable[[str], None] = lambda text: None,
) -> Fit:
    """Identify the parameters.

    The misfit is that of the hammer's displacement in rulers, at samples spread evenly over time and movement together,
    so that a long hold does not outweigh the blow. It is robust (pseudo-Huber): what the model lacks, such as a bounce
    after the release, must not drag the rest along. Each stroke counts as `INDEPENDENT` values that scatter by
    `SCATTER`, whatever its length: residuals of a model are not white, and intervals from white ones would be many
    times too small. The speed before each impact is a value of its own that scatters by `SPEED_SCATTER`: it is what an
    action is built for, and lies in a few samples.

    Parameters
    ----------
    start : (p,)
    runs : most evaluations of the misfit, slopes not counted
    say : told of the progress

    Raises
    ------
    ValidationInputError
        There is no stroke to fit.
    """
    if not strokes:
        raise ValidationInputError("identification: no stroke to fit; choose some that are not held out")

    def slopes(z: Array) -> Array:
        here = misfit(z, strokes, predict)
        out = np.empty((here.size, z.size))
        for i in range(z.size):
            step = DIFFERENCE if z[i] < LIMIT - DIFFERENCE else -DIFFERENCE
            moved = z.copy()
            moved[i] += step
            out[:, i] = (misfit(moved, strokes, predict) - here) / step
        say(f"misfit {0.5 * float(here @ here):.1f}")
        return out

    before = misfit(start, strokes, predict)
    found = least_squares(
        lambda z: misfit(z, strokes, predict), start, jac=slopes, bounds=(-LIMIT, LIMIT), max_nfev=runs, xtol=1e-3,
        ftol=2e-3,
    )  # fmt: skip
    covariance = np.linalg.inv(found.jac.T @ found.jac)  # the priors' rows keep it regular
    return Fit(found.x, covariance, 0.5 * float(before @ before), float(found.cost), int(found.nfev))


SCHEMA = "piano-action-rig identified positions 3"
FILE = "identified.json"
MODELS = ("regulated", "null", "identified")


@dataclass(frozen=True)
class Identified:
    """An identified set."""

    action: str  # name or path of the action whose parameters were changed
    session: str  # where it was identified
    seals: dict[str, str]  # SHA-256 of the strokes it was fitted to, by trial number
    # where the key's and hammer's calibrated points are and where the sensors look: it holds for these only
    sensors: dict[str, str]
    # names, null_names: tuple of str
    names: tuple[str, ...]
    # z, covariance, null_z, null_covariance: lists, in standard deviations of the priors
    z: list[float]
    covariance: list[list[float]]
    null_names: tuple[str, ...]
    null_z: list[float]
    null_covariance: list[list[float]]
    misfit: dict[str, float]  # before and after
    # dict of str to PredictionBand, for each model how its band was chosen and calibrated
    bands: dict[str, PredictionBand]
    mixture: Mixture  # The valleys kept; predictions are their mean. ``z`` is the best
    # for each model and fitted stroke the mixture found without strokes of its kind, from which the bands come
    left_out: dict[str, dict[str, Mixture]] = field(default_factory=dict)
    # RMS of the hammer in the release, rulers, of the fitted strokes: with which group of parameters left nominal, and
    # with which group alone identified
    release: dict[str, dict[str, float]] = field(default_factory=dict)
    # Properties of each fitted stroke (`validation.statistics.domain`): how far another lies from them is told by
    # these. Empty in a file that does not know
    strokes: dict[str, dict[str, Any]] = field(default_factory=dict)
    # black boxes fitted to the same strokes (`validation.prediction.black_boxes`), by kind
    black_boxes: dict[str, dict[str, Any]] = field(default_factory=dict)
    # fingerprints of the samples of each fitted stroke (`validation.measurement.sample_fingerprints`)
    samples: dict[str, list[str]] = field(default_factory=dict)

    def was_fitted_to(self, seal: str, samples: Collection[str]) -> bool:
        """Whether a stroke is one of those fitted: by its file, or by samples that it shares with one."""
        return seal in self.seals.values() or any(are_same_samples(samples, one) for one in self.samples.values())

    def check(self, strokes: tuple[Stroke, ...], where: str) -> None:
        """Refuse strokes measured by other sensors."""
        for stroke in strokes:
            found = sensors_of(stroke)
            for name, place in self.sensors.items():
                if found.get(name) != place:
                    raise ValidationInputError(
                        f"{where}: trial {stroke.number}: {name} is {found.get(name)!r}, the identified set holds for "
                        f"{place!r}; identify a set on this session, or leave --identified out"
                    )


def sensors_of(stroke: Stroke) -> dict[str, str]:
    """Places of the sensors and of the calibrated points, as text."""
    out = {}
    for one in (stroke.key, stroke.hammer):
        ruler = one.position.ruler
        out[f"{ruler.body} sensor"] = ruler.sensor_at
        out[f"{ruler.body} calibrated point"] = f"{ruler.calibrated_at}, {1e3 * one.travel_m:.2f} mm"
    return out


def write_identified(path: Path, identified: Identified) -> None:
    """Write the set as JSON."""
    plain = {"schema": SCHEMA, **asdict(identified)}
    write_text(path, json.dumps(plain, indent=1) + "\n")


def read_identified(path: Path) -> Identified:
    """Read a set from a file, or from the session folder that holds it.

    Raises
    ------
    ValidationInputError
        It is missing, another kind of file, or has other parameters.
    """
    file = path / FILE if path.is_dir() else path
    try:
        plain: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
    except OSError as error:
        raise ValidationInputError(f"{file}: cannot be read ({error.strerror}); name a file or session") from None
    except ValueError as error:
        raise ValidationInputError(f"{file}: not JSON ({error}); name an {FILE}") from None
    if not isinstance(plain, dict) or plain.pop("schema", None) != SCHEMA:
        raise ValidationInputError(f"{file}: not an identified set, its schema must be {SCHEMA!r}")
    try:
        plain["bands"] = {name: PredictionBand(**plain["bands"][name]) for name in MODELS}
        plain["mixture"] = Mixture(**plain["mixture"])
        left_out = plain.get("left_out", {}).items()
        plain["left_out"] = {name: {n: Mixture(**sets) for n, sets in of.items()} for name, of in left_out}
        found = Identified(**{**plain, **{key: tuple(plain[key]) for key in ("names", "null_names")}})
    except (TypeError, KeyError) as error:
        raise ValidationInputError(f"{file}: a field is missing or unknown ({error}); identify it again") from None
    if found.names != NAMES or found.null_names != NAMES[: len(SENSORS)]:
        raise ValidationInputError(f"{file}: its parameters are not those of this version; identify it again")
    return found


DRAWS, SEED, SPREAD = 24, 5, 0.15
"""Seeded draws that are tried beside nominal: from the priors, or about a set that is given, so far from it."""
STARTS, COARSE, FINE = 3, 4, 6
"""At how many places a search begins; most evaluations of a first fit, and of one that is carried on."""
VALLEYS, AS_GOOD = 2, 1.5
"""So many first fits are carried on at most, those within this factor of the best misfit."""
INDEPENDENT_PHASES = 4
"""What a stroke counts for in the weight of a valley: one value a phase, since a model's errors go on within one."""
GROUPS = {
    "repetition spring": ("spring", "spring_torque", "lever_friction", "repetition_pad", "drop"),
    "hammer's mass": ("hammer_mass",),
    "back check": ("check", "check_friction"),
    "friction and damping": ("hammer_friction", "knuckle_friction", "rest_damping", "knuckle_damping"),
    "felt between key and whippen": ("key_felt",),
    "jack, let-off, stop": ("let_off", "jack_pad", "capstan", "string", "stop_felt", "stop_damping"),
    "hammer's sensor near rest": tuple(one.name for one in SENSORS if one.name.startswith("hammer_curve")),
    "sensors": tuple(one.name for one in SENSORS),
}


def identify_session(
    session: Session,
    trials: Sequence[int],
    action_name: str,
    say: Callable[[str], None] = lambda text: None,
    start: Identified | None = None,
) -> Identified:
    """Identify a set on some strokes of a session.

    Parameters
    ----------
    trials : strokes to fit; at least two, so that bands can be calibrated on what was left out
    action_name : built-in action or file whose parameters are changed
    say : told of the progress
    start : a set that searches are carried on from, of these or of other strokes; the misfit has many valleys, and from
        the priors alone a search may end in a worse one

    Raises
    ------
    ValidationInputError
        A trial is not usable, or there are fewer than two.
    """
    usable, refused = measure_positions(session)
    by_number = {stroke.number: stroke for stroke in usable}
    if missing := [n for n in trials if n not in by_number]:
        reason = refused.get(missing[0], "there is no such trial")
        raise ValidationInputError(f"{session.path}: trial {missing[0]} cannot be identified on: {reason}")
    if len(set(trials)) < 2:
        raise ValidationInputError(f"{session.path}: {len(set(trials))} trial to identify on, allowed from 2")
    strokes = [by_number[n] for n in trials]
    action = model.load_action(action_name)
    full, null = of_model(action), of_null(action)
    say("identified set: all strokes")
    begin = None if start is None else np.array(start.z)
    best, mixture = search(strokes, full, len(FREE), say, begin=begin)
    null_best, _ = search(strokes, null, len(SENSORS), say, begin=begin)
    left_out: dict[str, dict[str, Mixture]] = {"null": {}, "identified": {}}
    for kind in dict.fromkeys(map(kind_of, strokes)):
        say(f"without {kind}")
        others = [one for one in strokes if kind_of(one) != kind]
        null_left = search(others, null, len(SENSORS), say, starts=2, begin=begin)[1]
        left = search(others, full, len(FREE), say, starts=1, begin=begin)[1]
        for stroke in strokes:
            if kind_of(stroke) == kind:
                left_out["null"][str(stroke.number)], left_out["identified"][str(stroke.number)] = null_left, left
    return Identified(
        action=action_name,
        session=session.info.name or session.path.name,
        seals={str(n): session.trial(n).sha256 for n in trials},
        sensors=sensors_of(strokes[0]),
        names=NAMES,
        z=best.z.tolist(),
        covariance=best.covariance.tolist(),
        null_names=NAMES[: len(SENSORS)],
        null_z=null_best.z.tolist(),
        null_covariance=null_best.covariance.tolist(),
        misfit={"before": _cost(np.zeros(len(FREE)), strokes, full), "after": best.cost, "null": null_best.cost},
        bands=bands_of(strokes, action, left_out),
        mixture=mixture,
        left_out=left_out,
        release=explain_release(strokes, full, best.z),
        samples={str(stroke.number): list(stroke.samples) for stroke in strokes},
        **known_of(strokes),
    )


def known_of(strokes: Sequence[Stroke]) -> dict[str, dict[str, dict[str, Any]]]:
    """What a set keeps of the strokes it was fitted to: ``strokes`` and ``black_boxes`` of `Identified`."""
    boxes = fit_black_boxes([example_of(stroke) for stroke in strokes])
    return {
        "strokes": {str(one.number): extract_features(one.time_s, one.key.value_m, "m") for one in strokes},
        "black_boxes": {kind: box.plain() for kind, box in boxes.items()},
    }


def example_of(stroke: Stroke) -> Example:
    """A stroke as a black box sees it: displacement of the key in, of the hammer out, m."""
    return Example(stroke.time_s, stroke.key.value_m, stroke.time_s, stroke.hammer.value_m[:, None])


def bands_of(
    strokes: Sequence[Stroke], action: model.Action, left_out: dict[str, dict[str, Mixture]]
) -> dict[str, PredictionBand]:
    """Choose and calibrate the band of each model on strokes predicted by parameters that have not seen them."""
    full, null, nominal = of_model(action), of_null(action), Mixture.of_one(np.zeros(len(FREE)))
    found = {}
    for name, predict in (("regulated", full), ("null", null), ("identified", full)):
        left = []
        for stroke in strokes:
            sets = left_out.get(name, {}).get(str(stroke.number), nominal)
            prediction = sets.predict(predict, stroke)
            left.append(PredictedStroke(stroke, prediction, estimate_spread(stroke, predict, sets, prediction)))
        found[name] = prediction_band(left)
    return found


def _cost(z: Array, strokes: Sequence[Stroke], predict: Predict) -> float:
    r = misfit(z, strokes, predict)
    return 0.5 * float(r @ r)


def kind_of(stroke: Stroke) -> str:
    """How a stroke was played; one of which that is not said is a kind of its own."""
    return stroke.condition or f"trial {stroke.number}"


def search(
    strokes: Sequence[Stroke],
    predict: Predict,
    size: int,
    say: Callable[[str], None],
    *,
    starts: int = STARTS,
    begin: Array | None = None,
) -> tuple[Fit, Mixture]:
    """Find the valleys of a misfit that has many.

    Fits begin at several places; the best of them are carried on, and are the mixture. With one start it is the set
    that is given, or nominal.
    A valley weighs as the likelihood of a scatter that is not known, misfit to the power −n/2, with
    `INDEPENDENT_PHASES` values a stroke.

    Parameters
    ----------
    size : how many of the parameters, the first ones, are fitted
    say : told of the progress
    starts : at how many places fits begin
    begin : the set that is given, (p,) or longer

    Returns
    -------
    Fit, Mixture
        The best, and all.
    """
    random = np.random.default_rng(SEED)
    begun = [np.zeros(size) if begin is None else begin[:size]]
    if starts > 1:
        spread = 1.0 if begin is None else SPREAD
        draws = [begun[0] + spread * random.standard_normal(size) for _ in range(DRAWS)]
        draws += [] if begin is None else [np.zeros(size)]
        draws = [np.clip(z, -LIMIT, LIMIT) for z in draws]
        draws = sorted(draws, key=lambda z: _cost(z, strokes, predict))[: starts - 1]
        coarse = [fit(strokes, predict, z, runs=COARSE, say=say) for z in (*begun, *draws)]
        least = min(one.cost for one in coarse)
        begun = [one.z for one in sorted(coarse, key=lambda one: one.cost) if one.cost < AS_GOOD * least][:VALLEYS]
    fine = sorted((fit(strokes, predict, z, runs=FINE, say=say) for z in begun), key=lambda one: one.cost)
    weight = np.array([one.cost / fine[0].cost for one in fine]) ** (-0.5 * INDEPENDENT_PHASES * len(strokes))
    return fine[0], Mixture([one.z.tolist() for one in fine], (weight / weight.sum()).tolist())


def explain_release(strokes: Sequence[Stroke], predict: Predict, z: Array) -> dict[str, dict[str, float]]:
    """RMS of the hammer in the release (rulers) with each group left nominal, and with it alone identified.

    Sensors stay as identified when another group stands alone: they are no part of the action.
    """

    def rms(values: Array) -> float:
        squares = []
        for stroke in strokes:
            try:
                error = (predict(values, stroke, None) - stroke.hammer.value_m) / stroke.hammer.travel_m
            except model.ModelError:
                return float("nan")
            squares.append(np.mean(error[find_phases(stroke) == RELEASE] ** 2))
        return float(np.sqrt(np.mean(squares)))

    out = {"nothing": {"nominal": rms(z), "alone": rms(np.where(_of("sensors"), z, 0.0))}}
    for group in GROUPS:
        chosen = _of(group)
        out[group] = {
            "nominal": rms(np.where(chosen, 0.0, z)),
            "alone": rms(np.where(chosen | _of("sensors"), z, 0.0)),
        }
    return out


def _of(group: str) -> NDArray[np.bool_]:
    return np.array([name in GROUPS[group] for name in NAMES])
