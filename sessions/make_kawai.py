"""Make `sessions/kawai_kg3c` of the recording of a real action: import, identification, everything but the text files.

Run:  python sessions/make_kawai.py kawai_kg3c_e4_part1.csv.gz kawai_kg3c_e4_repeated.csv.gz [--out FOLDER]
      python sessions/make_kawai.py [--without CONDITION] [--start sessions/kawai_kg3c/identified.toml]

The recording is gzweigle/Piano-Data, folder kawai_kg-3c_action/hammer_and_damper0, its first 38.46 s as two tables of
time and two readings; README.md of the session says more. The second form fits the trials that are there; without one
condition it says how well the others tell it. Minutes of processor time.

The fit is that of one action to strokes of several kinds. Its misfit is robust, since the model lacks something in
every release, and a stroke of any length counts as `INDEPENDENT` values.
"""

from __future__ import annotations

import argparse
import gzip
import shutil
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d
from scipy.optimize import least_squares

import model
import rig
import validation
from model.errors import ModelError
from model.motion_driven.prescribed_key import run_prescribed
from rig.session import Session
from validation.conventions import HAMMER
from validation.events.strikes import find_key_phases, find_key_strikes
from validation.infer.budget import OUT_OF_BUDGET, End
from validation.infer.result import Identification, apply_calibration
from validation.measurement.position_sensors import (
    ERROR_NAMES,
    N_KEY,
    PositionSensors,
    SensorCalibration,
    calibration_of,
)
from validation.measurement.positions import measure_positions
from validation.measurement.trial import MeasuredTrial
from validation.prediction.black_boxes import fit_black_boxes
from validation.prediction.posterior import TRIALS, make_posterior
from validation.statistics.rivals import describe_stroke, make_example

Array = NDArray[np.float64]

HOME = Path(__file__).parent / "kawai_kg3c"
FILE = "identified.toml"
FIT_TO = "2,3,5,7,8"
"""Slow press, medium stroke, two fast ones, four of the eight repeated; the slide-off and a fast one are held out."""
ACTION = model.load_action("hirschkorn2004-regulated")


@dataclass(frozen=True)
class Free:
    """A parameter that is fitted: its paths, and the standard uncertainty of its prior, relative where a factor."""

    name: str
    paths: tuple[str, ...]
    u: float
    factor: bool = True


def _screw(name: str, path: str, u_m: float) -> Free:
    return Free(name, (path,), u_m, factor=False)


def _felt(contact: str) -> Free:
    return Free(contact, tuple(f"{contact}.normal.{x}" for x in "abc"), 1.0)


FREE = (
    _screw("let-off button", "contact08.second.y", 2e-3),
    _screw("drop screw", "contact11.first.y", 2e-3),
    _screw("back-check wire", "contact04.second.x", 4e-3),
    _screw("jack rest pad", "contact05.second.x", 5e-4),
    _screw("repetition rest pad", "contact06.second.y", 1e-3),
    _screw("capstan", "contact01.first.y", 5e-4),
    _screw("height of the stop", "contact12.second.y", 3e-3),
    _felt("contact12"),
    Free("contact12.normal.D", ("contact12.normal.D",), 1.0),
    _felt("contact01"),
    Free("repetition_spring.stiffness", ("repetition_spring.stiffness",), 0.5),
    Free("repetition_spring.torque", ("repetition_spring.torque",), 0.015, factor=False),
    Free("hammer's mass and inertia", ("hammer.mass", "hammer.inertia"), 0.2),
    Free("hammer.joint_friction.A", ("hammer.joint_friction.A",), 0.7),
    Free("repetition.joint_friction.A", ("repetition.joint_friction.A",), 0.7),
    Free("friction under the knuckle", ("contact07.friction.A", "contact10.friction.A"), 0.5),
    Free("contact04.friction.A", ("contact04.friction.A",), 0.5),
    Free("contact13.normal.D", ("contact13.normal.D",), 0.7),
    Free("damping of the knuckle", ("contact07.normal.D", "contact10.normal.D"), 0.7),
)
N_SENSORS = len(ERROR_NAMES)
SCATTER = 0.05
"""What the model is expected to miss the hammer by, in rulers."""
SPEED_SCATTER = 0.03
"""What it is expected to miss the speed before an impact by, relative."""
INDEPENDENT = 60.0
APART_S, APART = 0.02, 0.02
"""Samples of the misfit are so far apart: in time, or the hammer in rulers."""
LIMIT = 4.0
"""Parameters stay within so many standard uncertainties of their priors."""
STEPS = (0.25, 0.12, 0.06)
"""Steps of the differences in u: contacts make the misfit rough."""
COARSE, FINE = 4, 10
"""Most evaluations of a fit after a hop, and of the last."""
SEED, DRAWS, STARTS, CARRIED_ON, HOPS = 1, 40, 6, 2, 80
WIDTH, HOP, MOVED = 0.7, 0.3, 0.4
"""Standard deviation of the draws and of a hop, u, and the share of the parameters that a hop moves."""
WIDEST = 3.9
LEAST_GAIN = 0.05
TOLERANCE = 2e-4
SLOW_SHARE_PER_S = 5.0
"""Speed in rulers a second below which a stroke is a slow press: some 0.25 m/s of the head."""
HAMMER_COLUMN = 2
FLIES_ON_S = 0.06


def action_of(z: Array) -> model.Action:
    """The action at ``z``, which begins with the errors of the sensors."""
    values = {}
    for one, x in zip(FREE, z[N_SENSORS:], strict=True):
        for path in one.paths:
            values[path] = ACTION[path] * np.exp(one.u * x) if one.factor else ACTION[path] + one.u * x
    return ACTION.with_values(values, "kawai_kg3c")


@lru_cache(maxsize=400)
def _hammer_turn(moving: bytes, m: MeasuredTrial) -> Array:
    """Changes of the hammer's angle (n,), rad, by what moves it: errors of its own sensor do not."""
    z = np.frombuffer(moving)
    action, sensors = action_of(z), _sensors(z, m)
    motion = sensors.key_motion(float(model.rest_state(action).angle_rad[0]))
    run = run_prescribed(action, motion, m.time_s, tolerance=TOLERANCE)
    return np.asarray(run.angle_rad[:, HAMMER] - run.angle_rad[0, HAMMER])


def _sensors(z: Array, m: MeasuredTrial) -> PositionSensors:
    assert m.sensors is not None
    return replace(m.sensors, calibration=SensorCalibration(tuple(z[:N_SENSORS].tolist())))


def predict(z: Array, m: MeasuredTrial) -> Array:
    """What the hammer's sensor reads of a trial (n,), in rulers; NaN where the action cannot follow."""
    moving = z.copy()
    moving[N_KEY:N_SENSORS] = 0.0
    try:
        turn = _hammer_turn(moving.tobytes(), m)
    except ModelError:
        return np.full(m.time_s.size, np.nan)
    return _sensors(z, m).read_hammer(turn) / _ruler(m)


def _ruler(m: MeasuredTrial) -> float:
    """The ruler's end as a change of angle, rad."""
    assert m.sensors is not None
    return float(m.sensors.as_turn(np.array([1.0]))[0])


@lru_cache(maxsize=64)
def _chosen_samples(m: MeasuredTrial) -> NDArray[np.int64]:
    hammer = m.change_rad[:, HAMMER_COLUMN] / _ruler(m)
    steady = gaussian_filter1d(hammer, 2.0)
    length = np.concatenate([[0.0], np.cumsum(np.diff(m.time_s) / APART_S + np.abs(np.diff(steady)) / APART)])
    return np.unique(np.searchsorted(length, np.arange(0.0, length[-1])))


@lru_cache(maxsize=64)
def _strikes(m: MeasuredTrial) -> list[tuple[int, int]]:
    key, step = m.sensors.key_m, float(m.time_s[1] - m.time_s[0])  # type: ignore[union-attr]
    every = find_key_strikes(key, find_key_phases(key, step))
    nexts = [*(start for start, _ in every[1:]), m.time_s.size]
    return [
        (first, min(end + round(FLIES_ON_S / step), before)) for (first, end), before in zip(every, nexts, strict=True)
    ]


def _speeds(m: MeasuredTrial, hammer: Array) -> Array:
    """Speed from 60 to 90 % of the way of each strike, rulers a second; NaN where it does not come so far."""
    out = []
    for first, end in _strikes(m):
        part = hammer[first:end]
        top = int(np.argmax(part > part.max() - 0.005))
        if top < 2 or first + int(np.argmax(part)) == m.time_s.size - 1:
            out.append(np.nan)
            continue
        rise, at = np.maximum.accumulate(part[: top + 1]), m.time_s[first : first + top + 1]
        low, high = (float(np.interp(share * part.max(), rise, at)) for share in (0.6, 0.9))
        out.append(0.3 * part.max() / max(high - low, 1e-4))
    return np.array(out)


def misfit(z: Array, trials: Sequence[MeasuredTrial]) -> Array:
    """Residuals: one a parameter (its prior), then of every trial those of its samples and of its speeds."""
    parts = [z]
    for m in trials:
        at, made, measured = _chosen_samples(m), predict(z, m), m.change_rad[:, HAMMER_COLUMN] / _ruler(m)
        error = np.clip(np.nan_to_num((made - measured)[at], nan=1.0), -1.0, 1.0) / SCATTER
        parts.append(_robust(error) * np.sqrt(INDEPENDENT / at.size))
        speeds = _speeds(m, measured)
        fast = speeds > SLOW_SHARE_PER_S
        there = _speeds(m, np.nan_to_num(made))[fast]
        parts.append(_robust(np.nan_to_num(there / speeds[fast] - 1.0, nan=1.0) / SPEED_SCATTER))
    return np.concatenate(parts)


def _robust(error: Array) -> Array:
    """Pseudo-Huber: residuals whose squares grow like the errors where these are large."""
    return np.asarray(np.sign(error) * np.sqrt(2.0 * (np.sqrt(1.0 + error**2) - 1.0)))


def fit(trials: Sequence[MeasuredTrial], start: Array, step: float, runs: int) -> tuple[Array, Array, float]:
    """Most probable z (p,) from a start, its covariance (p, p), and half the sum of squares."""

    def slopes(z: Array) -> Array:
        here = misfit(z, trials)
        out = np.empty((here.size, z.size))
        for i in range(z.size):
            by = step if z[i] < LIMIT - step else -step
            out[:, i] = (misfit(z + by * (np.arange(z.size) == i), trials) - here) / by
        return out

    found = least_squares(
        lambda z: misfit(z, trials), start, jac=slopes, bounds=(-LIMIT, LIMIT), max_nfev=runs, xtol=1e-3, ftol=2e-3
    )
    return found.x, np.linalg.inv(found.jac.T @ found.jac), float(found.cost)  # the priors' rows keep it regular


def search(trials: Sequence[MeasuredTrial], start: Array | None, hops: int) -> tuple[Array, Array, float]:
    """The best of many fits: the misfit has many local minima. Seeded.

    Without a start, the best of `DRAWS` draws from the priors and the priors' middle are begun, and the best two of
    them carried on. Then the search hops: it moves some parameters by a draw, fits, and stays where the misfit is less.
    """
    random = np.random.default_rng(SEED)
    size = N_SENSORS + len(FREE)
    if start is None:
        draws = [np.zeros(size), *(WIDTH * random.standard_normal(size) for _ in range(DRAWS))]
        begun = sorted(draws, key=lambda z: _cost(z, trials))[:STARTS]
        found = sorted((fit(trials, np.clip(z, -WIDEST, WIDEST), STEPS[0], 5) for z in begun), key=_misfit_of)
        carried = [fit(trials, fit(trials, one[0], 0.15, 8)[0], STEPS[-1], 6) for one in found[:CARRIED_ON]]
        best = min(carried, key=_misfit_of)
    else:
        best = fit(trials, start, STEPS[-1], FINE)
    print(f"misfit {best[2]:.1f} before {hops} hops", flush=True)
    for k in range(hops):
        moved = random.random(size) < MOVED
        begun_at = np.clip(best[0] + HOP * random.standard_normal(size) * moved, -WIDEST, WIDEST)
        one = fit(trials, begun_at, float(random.choice(STEPS)), COARSE)
        if one[2] < best[2] - LEAST_GAIN:
            best = one
            print(f"hop {k + 1}: misfit {best[2]:.1f}", flush=True)
    return min((best, fit(trials, best[0], STEPS[-1], FINE)), key=_misfit_of)


def _misfit_of(found: tuple[Array, Array, float]) -> float:
    return found[2]


def z_of(action: model.Action) -> Array:
    """The parameters at which an action file stands that this program wrote."""
    screws = []
    for one in FREE:
        path = one.paths[0]
        screws.append((np.log(action[path] / ACTION[path]) if one.factor else action[path] - ACTION[path]) / one.u)
    return np.concatenate([calibration_of(action).z, screws])


def identified(session: Session, trials: Sequence[MeasuredTrial], best: tuple[Array, Array, float]) -> Identification:
    """What was found, as `validation.write_identified` takes it."""
    z, covariance, cost = best
    assert trials[0].sensors is not None
    u = np.sqrt(np.diag(covariance))[:N_SENSORS]
    sensors = SensorCalibration(tuple(z[:N_SENSORS].tolist()), tuple(u.tolist()), trials[0].sensors.sensors)
    name = session.info.name or session.path.name
    seals = {f"{name}, trial {m.number}": m.seal for m in trials}
    seen = [apply_calibration(m, sensors) for m in trials]
    moved = [(one.name, one.paths, one.u, one.factor) for one in FREE]
    posterior = replace(
        make_posterior(moved, covariance[N_SENSORS:, N_SENSORS:], seals),
        before={path: float(ACTION[path]) for one in FREE for path in one.paths},
        strokes={label: describe_stroke(m) for label, m in zip(seals, seen, strict=True)},
        samples={label: list(m.samples) for label, m in zip(seals, seen, strict=True)},
        black_boxes={
            kind: box.to_plain_values() for kind, box in fit_black_boxes([make_example(m) for m in seen]).items()
        },
    )
    said = (
        "the misfit has many local minima; the set lets the action's geometry answer like that piano and measures no "
        f"parts; misfit {_cost(np.zeros(z.size), trials):.0f} as it was, {cost:.1f} identified",
    )
    when = datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
    provenance = {"created_utc": when, "start": ACTION.name, TRIALS: seals, "made_by": "sessions/make_kawai.py"}
    return Identification(
        action=action_of(z),
        estimates=(),
        correlation=np.zeros((0, 0)),
        undetermined=(),
        determined=(),
        warnings=said,
        starts=(cost,),
        scatter={},
        scores={},
        events={},
        provenance=provenance,
        posterior=posterior,
        sensors=sensors,
        end=End(OUT_OF_BUDGET, "the best of a seeded search"),
        details=None,
    )


def _cost(z: Array, trials: Sequence[MeasuredTrial]) -> float:
    r = misfit(z, trials)
    return 0.5 * float(r @ r)


def identify(folder: Path, numbers: Sequence[int], without: str, start: Path | None, hops: int) -> None:
    """Fit the trials of a session and write the set, or say how well kinds of stroke tell one that was left out."""
    session = Session.open(folder)
    data = {trial.number: trial.read() for trial in session.trials if trial.rejected is None}
    every = {n: measure_positions(one, SensorCalibration(), session.trial(n).sha256) for n, one in data.items()}
    chosen = [every[n] for n in numbers if data[n].condition != without]
    best = search(chosen, None if start is None else z_of(model.load_action(start)), hops)
    sensors = _sensors(best[0], chosen[0]).calibration
    boxes = fit_black_boxes([make_example(apply_calibration(m, sensors)) for m in chosen])
    for n, m in every.items():
        errors = {"identified": predict(best[0], m) - m.change_rad[:, HAMMER_COLUMN] / _ruler(m)}
        seen = make_example(apply_calibration(m, sensors))
        for kind, box in boxes.items():
            made = box.answers(seen.drive_s, seen.drive, seen.time_s) - seen.answers
            errors[kind] = made[:, HAMMER_COLUMN] / _ruler(m)
        missed = {name: 100 * float(np.sqrt(np.mean(error**2))) for name, error in errors.items()}
        listed = ", ".join(f"{name} {value:.1f} %" for name, value in missed.items())
        fitted = "" if m in chosen else ", not fitted"
        nearest = min(missed, key=lambda name: missed[name])
        print(f"trial {n} {data[n].condition}{fitted}, of the ruler: {listed}; nearest: {nearest}")
    print(f"misfit {best[2]:.1f}")
    if not without:
        validation.write_identified(identified(session, chosen, best), folder / FILE)


def main() -> None:
    """Import, identify, put the files in place."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "recordings", type=Path, nargs="*", help="The tables, .csv or .csv.gz; none: fit what is there."
    )
    parser.add_argument("--mapping", type=Path, default=HOME / "mapping.toml", help="Which column is what.")
    parser.add_argument("--out", type=Path, default=HOME, help="Session folder; its texts stay.")
    parser.add_argument("--fit", default=FIT_TO, help="Trials to identify on.")
    parser.add_argument("--without", default="", help="Condition to leave out: nothing is written then.")
    parser.add_argument("--start", type=Path, help="Set that the search is carried on from; default: the priors.")
    parser.add_argument("--hops", type=int, default=HOPS, help="How often the search begins again beside the best.")
    given = parser.parse_args()
    start = None if given.start is None else given.start.resolve()
    if given.recordings:
        with tempfile.TemporaryDirectory() as temporary:
            made = Path(temporary) / "kawai_kg3c"
            rig.import_session(made, given.recordings, rig.load_mapping(given.mapping))
            _excerpt(given.recordings[0], made / "excerpt.csv")
            given.out.mkdir(parents=True, exist_ok=True)
            for file in made.iterdir():
                shutil.copy(file, given.out / file.name)
    identify(given.out, [int(number) for number in given.fit.split(",")], given.without, start, given.hops)


def _excerpt(recording: Path, path: Path) -> None:
    """Write the rows of the last second and a half, an example of a further recording."""
    data = recording.read_bytes()
    lines = (gzip.decompress(data) if recording.suffix == ".gz" else data).decode().splitlines(keepends=True)
    path.write_text("".join([lines[0], *lines[-3000:]]))


if __name__ == "__main__":
    main()
