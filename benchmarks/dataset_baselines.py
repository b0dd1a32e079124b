"""Five baselines on the open split of the data set: null model, printed, regulated, identified set, and a black box.

    pianorig dataset make --out dataset && python -m benchmarks dataset_baselines --dataset dataset [--out FOLDER]

Each predicts the angles of every test trial from its force; scores as `pianorig dataset score` gives them, cost in
processor seconds. The black box knows nothing of actions: ridge regression of the angles on the force filtered by
exponentials and products of these (a Wiener model, stable by construction), each specimen
by itself. The identified set: ten parameters of the regulated one by bounded least squares on each specimen's train
trials without a planted fault; it does not know which were changed.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy.optimize import least_squares
from scipy.signal import lfilter

import model
from benchmarks.runner import Run, Table
from validation.dataset.files import Array, DataTrial, check_truth, read_index, trials_of
from validation.dataset.score import SCORED, score_curves, scored_trials

COLUMNS = [model.BODIES.index(name.removesuffix("_angle")) for name in SCORED]
FREE = {
    "key.joint_friction.A": 0.3, "hammer.joint_friction.A": 0.3, "contact07.friction.A": 0.3,
    "contact04.friction.A": 0.3,
    "contact01.normal.D": 0.4, "contact02.normal.D": 0.4, "repetition_spring.stiffness": 0.1,
    "contact08.second.y": 4e-4, "contact11.first.y": 4e-4, "contact04.second.x": 1e-3,
}  # fmt: skip
"""Free parameters of the identified set and widths of their priors: of logarithms, or m for the three screws."""
SCREWS = ("contact08.second.y", "contact11.first.y", "contact04.second.x")
EVERY = 10
SCATTER_RAD = np.array([5e-4, 1e-3, 5e-3])
TIME_CONSTANTS_S = (0.002, 0.005, 0.01, 0.02, 0.04, 0.08, 0.16, 0.32)
RIDGE = 1e-3


def force_of(trial: DataTrial) -> Array:
    """Force without the offset that the initialisation window shows, N."""
    still = trial.time_s < WINDOW_S
    return trial.values["force"] - trial.values["force"][still].mean()


def angles(solution: model.Solution) -> Array:
    """Angles of the scored bodies since the first sample (n, 3)."""
    chosen = solution.angle_rad[:, COLUMNS]
    return chosen - chosen[0]


def by_model(
    action: model.Action, simulate: Callable[..., model.Solution] = model.simulate
) -> Callable[[DataTrial], Array]:
    """Prediction by a model of an action."""
    return lambda trial: angles(simulate(action, trial.time_s, force_of(trial), tolerance=1e-4))


def identified(train: list[DataTrial]) -> Callable[[DataTrial], Array]:
    """Prediction by the regulated set with ten parameters fitted to train trials."""
    base = model.load_action("hirschkorn2004-regulated")

    def action_of(z: Array) -> model.Action:
        return base.with_values(
            {
                path: base[path] + width * x if path in SCREWS else base[path] * float(np.exp(width * x))
                for (path, width), x in zip(FREE.items(), z, strict=True)
            }
        )

    def residual(z: Array) -> Array:
        parts = [z]
        for trial in train:
            measured = np.column_stack([trial.values[name] for name in SCORED])[::EVERY]
            try:
                made = by_model(action_of(z))(trial)[::EVERY]
            except model.ModelError:
                made = np.zeros_like(measured)
            error = ((made - measured) / SCATTER_RAD).ravel()
            robust = np.sign(error) * np.sqrt(2 * (np.sqrt(1 + error**2) - 1))
            parts.append(robust * np.sqrt(60.0 / error.size))
        return np.concatenate(parts)

    def slopes(z: Array) -> Array:
        here, step = residual(z), 0.1
        return np.column_stack([(residual(z + step * unit) - here) / step for unit in np.eye(z.size)])

    found = least_squares(residual, np.zeros(len(FREE)), jac=slopes, bounds=(-3, 3), max_nfev=8)
    return by_model(action_of(found.x))


def features(trial: DataTrial) -> Array:
    """Force through a bank of exponentials, and products of these (n, f)."""
    force, step = force_of(trial) / 10.0, float(trial.time_s[1] - trial.time_s[0])
    linear = [force]
    for constant in TIME_CONSTANTS_S:
        a = float(np.exp(-step / constant))
        linear.append(lfilter([1 - a], [1, -a], force))
    steep = [np.tanh(3 * one) for one in linear] + [np.tanh(8 * one) for one in linear]
    one = [*linear, *steep]
    products = [one[i] * one[k] for i in range(len(one)) for k in range(i, len(one))]
    return np.column_stack([np.ones(force.size), *one, *products])


def black_box(train: list[DataTrial]) -> Callable[[DataTrial], Array]:
    """Prediction by ridge regression on filtered force."""
    x = np.vstack([features(trial)[::EVERY] for trial in train])
    y = np.vstack([np.column_stack([trial.values[name] for name in SCORED])[::EVERY] for trial in train])
    scale = x.std(axis=0)
    scale[scale == 0] = 1.0
    normal = (x / scale).T @ (x / scale) + RIDGE * len(x) * np.eye(x.shape[1]) * 1e-3
    weights = np.linalg.solve(normal, (x / scale).T @ y) / scale[:, None]

    def predict(trial: DataTrial) -> Array:
        made = features(trial) @ weights
        return made - made[0]

    return predict


def main(run: Run) -> bool:
    """Score all five and print the table; whether the null model is the worst of all."""
    global WINDOW_S
    with tempfile.TemporaryDirectory() as place:
        dataset = Path(run.dataset or _made(Path(place) / "dataset"))
        index = read_index(dataset)
        WINDOW_S = float(index["window_s"])
        return _scored(dataset, index, run)


def _made(folder: Path) -> Path:
    """A small data set, where none is given."""
    command = [sys.executable, "-m", "pianorig", "dataset", "make", "--each", "2", "--no-films", "--out", str(folder)]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    return folder


def _scored(dataset: Path, index: dict[str, Any], run: Run) -> bool:
    faults = check_truth(dataset, dataset / index["open_truth"], "open")["faults"]
    train = [one for one in trials_of(dataset, "open", "train") if str(one.facts["trial"]) not in faults]
    tests = scored_trials(dataset)
    printed, regulated = model.load_action("hirschkorn2004"), model.load_action("hirschkorn2004-regulated")
    makers: dict[str, Callable[[list[DataTrial]], Callable[[DataTrial], Array]]] = {
        "null model": lambda _: by_model(regulated, model.null_model.simulate),
        "printed set": lambda _: by_model(printed),
        "regulated set": lambda _: by_model(regulated),
        "black box": black_box,
        "identified set": identified,
    }
    for warm in ("null model", "printed set"):  # compiled before the clock runs
        makers[warm]([])(tests[0])
    table = Table("baseline:15s", *(f"{name}:.2f" for name in SCORED), "score:.2f", "cpu s:.2f", "cpu ms a trial:.2f")
    scores = {}
    for name in run.only or makers:
        curves: dict[int, Array] = {}
        fitting = predicting = 0.0
        for specimen in sorted({str(one.facts["specimen"]) for one in tests}):
            begun = time.process_time()
            predict = makers[name]([one for one in train if one.facts["specimen"] == specimen])
            fitted = time.process_time()
            for trial in (one for one in tests if one.facts["specimen"] == specimen):
                curves[int(trial.facts["trial"])] = predict(trial)
            fitting, predicting = fitting + fitted - begun, predicting + time.process_time() - fitted
        found = score_curves(dataset, curves)
        scores[name] = found.overall
        costs = fitting + predicting, 1e3 * predicting / len(tests)
        table.row(name, *(found.by_channel[channel] for channel in SCORED), found.overall, *costs)
        if run.out:
            _write(Path(run.out) / f"{name.replace(' ', '_')}.csv", tests, curves)
    if len(scores) == len(makers):
        run.figure("dataset", " / ".join(f"{scores[name]:.1f}" for name in makers) + " % of the range")
    return max(scores.values()) == scores["null model"]


def _write(path: Path, tests: list[DataTrial], curves: dict[int, Array]) -> None:
    """Write predictions as `pianorig dataset score` reads them."""
    path.parent.mkdir(parents=True, exist_ok=True)
    parts = []
    for trial in tests:
        number = int(trial.facts["trial"])
        columns = {"trial": number, "time": trial.time_s}
        parts.append(pd.DataFrame({**columns, **{name: curves[number][:, k] for k, name in enumerate(SCORED)}})[::5])
    pd.concat(parts).to_csv(path, index=False, float_format="%.7g")


WINDOW_S = 0.2
