"""One whole session on the virtual bench, recorded once: five forte blows, one filmed, tracked and validated."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import model
import validation
from pianorig.commands.demo import Demo, run_demo
from pianorig.workflows import recording as bench_record
from rig.simulated import FilmTruth, PlantTruth, film_trial, load_plant
from tests.conftest import leave_out_figures

BENCH = Path(__file__).parents[2] / "rig" / "simulated" / "bench.toml"


FINE = 20
FRAMES = 700
"""Of the film: until the hammer is held in check."""
QUICK = {"explain": False, "budget": False}


def replay(bench: Path, trial: int, command_v: np.ndarray) -> PlantTruth:
    """What really happened in a trial: the plant played again with the recorded command, at 100 kHz.

    Finer than the sample clock, because speeds jump within a sample where the hammer meets the string.
    """
    plant = load_plant(bench, None, 5000.0 * FINE)
    plant.start_trial(trial)
    plant.advance(np.repeat(command_v, FINE))
    return plant.truth()


@dataclass(frozen=True)
class Closed:
    """A demo and the truth of each of its trials."""

    demo: Demo
    truth: dict[int, PlantTruth]


@pytest.fixture(scope="session")
def closed(shared: Callable[..., Closed]) -> Closed:
    def make(folder: Path) -> Closed:
        """A third of its film; no explanation of the difference, no uncertainty of the prediction and no figures."""

        def film_blow(path: Path, times: np.ndarray, *given: Any, **options: Any) -> FilmTruth:
            return film_trial(path, times[:FRAMES], *given, **options)

        validate = validation.validate_session
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(validation, "validate_session", lambda *of, **how: validate(*of, **how | QUICK))
            leave_out_figures(patch)
            patch.setattr(bench_record, "film_trial", film_blow)
            demo = run_demo(folder / "session", trials=5)
        return Closed(demo, {t.number: replay(BENCH, t.number, t.read().motor_command_v) for t in demo.session.trials})

    return shared(make)


def fine_height(truth: PlantTruth, start: float, end: float) -> tuple[np.ndarray, np.ndarray]:
    """Times every microsecond and the hammer's height there."""
    time = np.arange(start, end, 1e-6)
    return time, model.observables.hammer_height_m(truth.action, truth.angles_at(time)[:, :5])
