"""Five baselines on the open split of the data set: null model, printed, regulated, identified set, and a black box.

    pianorig dataset make --out dataset && python -m benchmarks dataset_baselines --dataset dataset

Each predicts the angles of every test trial from its force; scores as `pianorig dataset score` gives them, cost in
processor seconds. The black box knows nothing of actions: ridge regression of the angles on the force filtered by
exponentials and products of these (a Wiener model, stable by construction), each specimen by itself. The identified
set: ten parameters of the regulated one by bounded least squares on each specimen's train trials without a planted
fault; it does not know which were changed.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from itertools import combinations_with_replacement
from pathlib import Path

import numpy as np
from scipy.signal import lfilter

import model
from benchmarks.domain import least_misfit
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
TIME_CONSTANTS_S = (0.002, 0.005, 0.01, 0.02, 0.04, 0.08, 0.16, 0.32)
RIDGE = 1e-6
SCATTER_RAD = np.array([5e-4, 1e-3, 5e-3])


Answer = Callable[[DataTrial], Array]


def turned(trial: DataTrial) -> Array:
    """Measured angles of the scored bodies (n, 3)."""
    return np.column_stack([trial.values[name] for name in SCORED])


class Baselines:
    """What each baseline makes of train trials; ``window_s``: in which a trial is still, so that its force has none."""

    def __init__(self, window_s: float) -> None:
        self.window_s = window_s
        printed, self.regulated = model.load_action("hirschkorn2004"), model.load_action("hirschkorn2004-regulated")
        self.makers: dict[str, Callable[[list[DataTrial]], Answer]] = {
            "null model": lambda _: self.by_model(self.regulated, model.null_model.simulate),
            "printed set": lambda _: self.by_model(printed),
            "regulated set": lambda _: self.by_model(self.regulated),
            "black box": self.black_box,
            "identified set": self.identified,
        }

    def force_of(self, trial: DataTrial) -> Array:
        """Force without the offset that the initialisation window shows, N."""
        return trial.values["force"] - trial.values["force"][trial.time_s < self.window_s].mean()

    def by_model(self, action: model.Action, simulate: Callable[..., model.Solution] = model.simulate) -> Answer:
        """Prediction by a model of an action: angles since the first sample."""

        def predict(trial: DataTrial) -> Array:
            turn = simulate(action, trial.time_s, self.force_of(trial), tolerance=1e-4).angle_rad[:, COLUMNS]
            return turn - turn[0]

        return predict

    def identified(self, train: list[DataTrial]) -> Answer:
        """Prediction by the regulated set with ten parameters fitted to train trials."""
        base = self.regulated

        def by(z: Array) -> Answer:
            values = {
                path: base[path] + width * x if path in SCREWS else base[path] * float(np.exp(width * x))
                for (path, width), x in zip(FREE.items(), z, strict=True)
            }
            return self.by_model(base.with_values(values))

        def errors(z: Array) -> Iterator[Array]:
            for trial in train:
                measured = turned(trial)[::EVERY]
                try:
                    made = by(z)(trial)[::EVERY]
                except model.ModelError:
                    made = np.zeros_like(measured)
                yield ((made - measured) / SCATTER_RAD).ravel()

        return by(least_misfit(errors, len(FREE), 8))

    def features(self, trial: DataTrial) -> Array:
        """Force through a bank of exponentials, and products of these (n, f)."""
        force, step = self.force_of(trial) / 10.0, float(trial.time_s[1] - trial.time_s[0])
        shares = [float(np.exp(-step / constant)) for constant in TIME_CONSTANTS_S]
        linear = [force, *(lfilter([1 - a], [1, -a], force) for a in shares)]
        one = [*linear, *(np.tanh(by * x) for by in (3, 8) for x in linear)]
        return np.column_stack([np.ones(force.size), *one, *(x * y for x, y in combinations_with_replacement(one, 2))])

    def black_box(self, train: list[DataTrial]) -> Answer:
        """Prediction by ridge regression on filtered force."""
        x = np.vstack([self.features(trial)[::EVERY] for trial in train])
        y = np.vstack([turned(trial)[::EVERY] for trial in train])
        scale = x.std(axis=0)
        scale[scale == 0] = 1.0
        normal = (x / scale).T @ (x / scale) + RIDGE * len(x) * np.eye(x.shape[1])
        weights = np.linalg.solve(normal, (x / scale).T @ y) / scale[:, None]

        def predict(trial: DataTrial) -> Array:
            made = self.features(trial) @ weights
            return made - made[0]

        return predict


def made(folder: Path) -> Path:
    """A small data set, where none is given."""
    command = [sys.executable, "-m", "pianorig", "dataset", "make", "--each", "2", "--no-films", "--out", str(folder)]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    return folder


def main(run: Run) -> bool:
    """Score all five and print the table; whether the null model is the worst of all."""
    with tempfile.TemporaryDirectory() as place:
        return scored(Path(run.dataset or made(Path(place) / "dataset")), run)


def scored(dataset: Path, run: Run) -> bool:
    """Print the table of a data set; whether the null model is the worst of all."""
    index = read_index(dataset)
    faults = check_truth(dataset, dataset / index["open_truth"], "open")["faults"]
    train = [one for one in trials_of(dataset, "open", "train") if str(one.facts["trial"]) not in faults]
    tests, makers = scored_trials(dataset), Baselines(float(index["window_s"])).makers
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
    if len(scores) == len(makers):
        run.figure("dataset", " / ".join(f"{scores[name]:.1f}" for name in makers) + " % of the range")
    return max(scores.values()) == scores["null model"]
