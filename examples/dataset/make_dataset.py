"""Make a data set of virtual strokes with known truth, and score predictions on it.

Run:  python examples/dataset/make_dataset.py make FOLDER [--seed 20041] [--each 3] [--no-films]
      python examples/dataset/make_dataset.py score FOLDER PREDICTIONS.csv

Two specimens whose parameters are drawn around the regulated action are played on the virtual bench, recorded by the
recorder, filmed and tracked; some trials carry one planted fault. `truth.json` states all of it. The task: predict the
encoder angles of the trials with part "test" from their force. It is simulated: a model with the same equations has an
advantage here that it has not on a piano.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import tomllib
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import tomli_w
import xarray as xr
from numpy.typing import NDArray

import model
import rig
import vision
from rig.simulated import ActionGeometry, CameraSettings, film_bodies, film_trial, open_backend

Array = NDArray[np.float64]

REST_S = 0.2
"""Rest before each stroke, s: the initialisation window, which is not scored."""
AFTER_S = 0.25
FORTE = ((0.0, 0.0), (0.01, 0.435), (0.02, 1.46), (0.03, 2.97), (0.04, 4.92), (0.05, 7.27), (0.06, 10.0))
"""Rise of a forte: corner points, s and N."""


def stroke(level_n: float, onsets_s: tuple[float, ...], hold_s: float, fall_s: float) -> list[tuple[float, float]]:
    """Corner points (s, N) of strokes that rise like a forte scaled to ``level_n``, one at each onset."""
    points: list[tuple[float, float]] = []
    for onset in onsets_s:
        points += [(onset + t, level_n / 10.0 * f) for t, f in FORTE]
        points += [(onset + 0.06 + hold_s, level_n), (onset + 0.06 + hold_s + fall_s, 0.0)]
    return points


CONDITIONS = {
    "forte": stroke(10.0, (0.0,), 0.2, 0.09),
    "mezzoforte": stroke(7.0, (0.0,), 0.2, 0.09),
    "mezzo": stroke(5.0, (0.0,), 0.2, 0.09),
    "mezzopiano": stroke(3.5, (0.0,), 0.2, 0.09),
    "piano": [(0.0, 0.0), (0.15, 1.25), (0.16, 1.25), (0.175, 0.72), (0.215, 0.72), (0.28, 1.5), (0.5, 1.5),
              (0.57, 0.0)],
    "double": stroke(10.0, (0.0, 0.2), 0.05, 0.03),
    "staccato": stroke(8.0, (0.0,), 0.01, 0.02),
    "repetition": stroke(6.0, (0.0, 0.16, 0.32, 0.48), 0.03, 0.03),
}  # fmt: skip
FILMED = ("forte", "mezzo", "piano")
"""Conditions whose first trial with specimen A is filmed."""

BASE = "hirschkorn2004-regulated"
SCREW_SD_M = {"contact08.second.y": 2e-4, "contact11.first.y": 2e-4, "contact04.second.x": 5e-4}
LOG_SD = {
    "key.joint_friction.A": 0.3, "whippen.joint_friction.A": 0.3, "hammer.joint_friction.A": 0.3,
    "contact01.friction.A": 0.2, "contact04.friction.A": 0.2, "contact07.friction.A": 0.2, "contact10.friction.A": 0.2,
    "contact01.normal.D": 0.3, "contact02.normal.D": 0.3, "contact03.normal.D": 0.3, "contact12.normal.D": 0.1,
    "hammer.mass": 0.03, "key.inertia": 0.03, "repetition_spring.stiffness": 0.05, "jack_spring.torque": 0.1,
}  # fmt: skip
FAULT_SHARE = 0.125
HUM_HZ = 60.0
CHANNELS = ("key", "whippen", "hammer")


def draw_specimen(random: np.random.Generator) -> dict[str, float]:
    """Draw parameter values around the base action, each within two standard deviations, that come to rest."""
    base = model.load_action(BASE)
    while True:
        draw = {path: float(np.clip(random.standard_normal(), -2, 2)) for path in (*SCREW_SD_M, *LOG_SD)}
        values = {path: base[path] + sd * draw[path] for path, sd in SCREW_SD_M.items()}
        values |= {path: base[path] * float(np.exp(sd * draw[path])) for path, sd in LOG_SD.items()}
        try:
            model.rest_state(base.with_values(values))
        except model.ModelError:
            continue
        return values


def write_bench(path: Path, values: dict[str, float]) -> None:
    """Write a bench file: the shipped bench with another specimen under its motor."""
    bench = tomllib.loads(resources.files("rig.simulated").joinpath("bench.toml").read_text(encoding="utf-8"))
    path.write_bytes(tomli_w.dumps({**bench, "specimen": {"action": BASE, "set": values}}).encode())


def plant_fault(fault: str, trial: xr.Dataset) -> xr.Dataset:
    """Return the trial with a fault of the measurement in its values."""
    time_s = trial["time"]
    if fault == "force gain":
        return trial.assign(force=1.15 * trial["force"])
    if fault == "hammer sign":
        return trial.assign(hammer_angle=-trial["hammer_angle"])
    if fault == "key counts":
        lowest_s = time_s[int(np.argmin(trial["key_angle"].to_numpy()))]
        return trial.assign(key_angle=trial["key_angle"] + 0.003 * (time_s > lowest_s))
    if fault == "hum":
        return trial.assign(force=trial["force"] + 0.8 * np.sin(2 * np.pi * HUM_HZ * time_s))
    if fault == "force drift":
        return trial.assign(force=trial["force"] + 1.0 * (time_s - time_s[0]))
    raise ValueError(f"fault {fault!r}: allowed {', '.join(FAULTS)}")


FAULTS = ("force gain", "hammer sign", "key counts", "hum", "force drift")


def profile_of(points: list[tuple[float, float]], random: np.random.Generator) -> rig.Profile:
    """The motor's profile of a stroke, stronger and slower by a few percent, with rest before and after."""
    strength, stretch = np.exp(np.array([0.05, 0.04]) * np.clip(random.standard_normal(2), -2, 2))
    times = REST_S + stretch * np.array([t for t, _ in points])
    forces = strength * np.array([f for _, f in points])
    return rig.Profile(
        "stroke", np.concatenate([[0.0], times, [times[-1] + AFTER_S]]), np.concatenate([[0.0], forces, [0.0]])
    )


def film_stroke(
    path: Path, backend: Any, frame_time_s: Array, seed: int
) -> dict[str, tuple[str, Array, dict[str, Any]]]:
    """Render the film of the stroke just played, track it, and return its angles as netCDF variables."""
    truth = backend.plant.truth()

    def pivot(body: str) -> tuple[float, float]:
        return truth.action[f"{body}.pivot.x"], truth.action[f"{body}.pivot.y"]

    whippen, jack, repetition = (float(angle) for angle in truth.film_angles_at(truth.time_s[:1])[0])
    geometry = ActionGeometry(pivot("whippen"), pivot("jack"), pivot("repetition"), (whippen, jack, repetition))
    settings = CameraSettings(frame_rate_hz=2000.0, width=200, height=152, scale_px_per_m=1600.0, flicker=0.0)
    bodies = film_bodies(geometry, settings)
    film_trial(path, frame_time_s, truth.film_angles_at, geometry, settings, seed)
    vision.save_bodies(path.with_name(path.stem + "_bodies.toml"), bodies)
    tracked = vision.track(path, bodies)
    variables = {}
    for body in ("jack", "repetition"):
        angle, u, _ = tracked.relative(body)
        variables[f"{body}_angle"] = ("film_time", angle, {"units": "rad", "standard_uncertainty": float(np.median(u))})
    return variables


def record_trial(file: Path, bench: Path, profile: rig.Profile, seed: int, film: bool) -> xr.Dataset:
    """Record one stroke on the virtual bench; film it beside ``file`` where asked."""
    config = rig.load_rig("virtual")
    backend = open_backend(f"sim://?bench={bench}&seed={seed}", config.config)
    try:
        with tempfile.TemporaryDirectory() as folder:
            session = rig.record(
                Path(folder) / "session", profile=profile, rig_config=config, trials=1, backend=backend
            )
            data = session.trial(1).read()
        names, angles = [one.name for one in data.encoders], data.angle_rad
        # a sample of the force shows what acted one group delay earlier
        force = np.interp(data.time_s + data.force_info.group_delay_s, data.time_s, data.raw_force_n)
        variables: dict[str, Any] = {"force": ("time", force, {"units": "N", "standard_uncertainty": 0.05})}
        for name in CHANNELS:
            angle = angles[:, names.index(name)]
            variables[f"{name}_angle"] = ("time", angle - angle[0], {"units": "rad", "standard_uncertainty": 5e-5})
        coordinates: dict[str, Any] = {"time": ("time", data.time_s, {"units": "s"})}
        if film and data.camera is not None:
            frames = data.camera.frame_time_s
            start = data.blow_start_s - 0.03
            frames = frames[(frames >= start) & (frames < min(start + 0.4, data.time_s[-1] - 1e-3))]
            variables |= film_stroke(file.with_name(file.stem + "_film.mraw"), backend, frames, seed)
            coordinates["film_time"] = ("film_time", frames, {"units": "s"})
    finally:
        backend.close()
    return xr.Dataset(variables, coords=coordinates, attrs={"Conventions": "CF-1.11"})


def make(out: Path, seed: int, each: int, films: bool) -> None:
    """Write trials as netCDF-4, their index and their truth into a new folder."""
    if out.exists():
        raise SystemExit(f"{out}: exists already; choose another name")
    if not 2 <= each <= 50:
        raise SystemExit(f"--each {each}: allowed 2 to 50")
    out.mkdir(parents=True)
    random = np.random.default_rng(seed)
    rows, truths = [], {}
    for specimen in ("A", "B"):
        values = draw_specimen(random)
        truths[specimen] = values
        bench = out / f"specimen_{specimen}.toml"
        write_bench(bench, values)
        for condition, points in CONDITIONS.items():
            print(f"specimen {specimen}, {condition}", file=sys.stderr)
            for k in range(each):
                number = len(rows) + 1
                fault = str(random.choice(FAULTS)) if random.random() < FAULT_SHARE else ""
                film = films and specimen == "A" and condition in FILMED and k == 0
                file = out / f"trial_{number:04d}.nc"
                trial = record_trial(file, bench, profile_of(points, random), seed + number, film)
                if fault:
                    trial = plant_fault(fault, trial)
                part = "test" if k == each - 1 else "train"
                row = {"trial": number, "specimen": specimen, "condition": condition, "part": part}
                trial.assign_attrs(row).to_netcdf(file, engine="h5netcdf")
                rows.append({**row, "file": file.name})
                truths[str(number)] = {"fault": fault}
        bench.unlink()
    pd.DataFrame(rows).to_csv(out / "trials.csv", index=False)
    (out / "truth.json").write_text(json.dumps(truths, indent=1, sort_keys=True) + "\n", encoding="utf-8")
    print(f"data set: {out} ({len(rows)} trials)")


def score(folder: Path, predictions: Path) -> None:
    """Print the RMSE after the initialisation window in percent of each channel's range over the test trials.

    The predictions have columns trial, time (s), key_angle, whippen_angle, hammer_angle (rad since the first sample).
    Trials with a planted fault are not scored.
    """
    truth = json.loads((folder / "truth.json").read_text(encoding="utf-8"))
    trials = pd.read_csv(folder / "trials.csv").query("part == 'test'")
    table = pd.read_csv(predictions)
    columns = [f"{name}_angle" for name in CHANNELS]
    squares, lowest, highest = [], [], []
    for _, row in trials.iterrows():
        if truth[str(row["trial"])]["fault"]:
            continue
        measured = xr.load_dataset(folder / row["file"], engine="h5netcdf")
        mine = table[table["trial"] == row["trial"]].sort_values("time")
        if mine.empty:
            raise SystemExit(f"{predictions}: trial {row['trial']} is missing; every test trial must be predicted")
        time_s = measured["time"].to_numpy()
        values = np.column_stack([measured[name] for name in columns])
        made = np.column_stack([np.interp(time_s, mine["time"], mine[name]) for name in columns])
        squares.append(np.mean((made - values)[time_s >= REST_S] ** 2, axis=0))
        lowest.append(values.min(axis=0))
        highest.append(values.max(axis=0))
    span = (np.array(highest) - np.array(lowest)).max(axis=0)
    percent = 100 * np.sqrt(np.array(squares)).mean(axis=0) / span
    for name, value in zip(columns, percent, strict=True):
        print(f"{name}: {value:.2f} % of its range")
    print(f"score: {percent.mean():.2f} % (less is better; {len(squares)} test trials without a planted fault)")


def main() -> None:
    """Read the command line and do the job."""
    parser = argparse.ArgumentParser(description="Make a data set of virtual strokes, or score predictions on it.")
    jobs = parser.add_subparsers(dest="job", required=True)
    making = jobs.add_parser("make")
    making.add_argument("folder", type=Path)
    making.add_argument("--seed", type=int, default=20041)
    making.add_argument("--each", type=int, default=3, help="trials of a condition and specimen, the last to test")
    making.add_argument("--no-films", action="store_true")
    scoring = jobs.add_parser("score")
    scoring.add_argument("folder", type=Path)
    scoring.add_argument("predictions", type=Path)
    options = parser.parse_args()
    if options.job == "make":
        make(options.folder, options.seed, options.each, not options.no_films)
    else:
        score(options.folder, options.predictions)


if __name__ == "__main__":
    main()
