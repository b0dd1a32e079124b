"""One session of the virtual bench's forte, the printed action, without faults: measured and predicted once."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

import model
from rig import Session
from tests.validation.bench_strokes import film, stroke_of
from validation.events.session_events import SessionEvents, find_session_events
from validation.measurement.measure_session import measure_session
from validation.options import ComparisonOptions
from validation.pipeline.compare_session import model_under_test
from validation.prediction.model_under_test import ModelUnderTest
from validation.prediction.predict_session import PredictedSession, predict_session

SEED = 4711
N_TRIALS = 6


@dataclass(frozen=True)
class Stage:
    """What the checks of a session are given."""

    predicted: PredictedSession
    events: SessionEvents
    tested: ModelUnderTest

    @property
    def trials(self):
        return self.predicted.trials

    def predictions(self, number):
        return self.predicted.predictions[number].model

    def geometry(self, m):
        return self.tested.geometry_at(m.force.preload_n)


@pytest.fixture(scope="session")
def stage(make, tmp_path_factory):
    session = Session.create(tmp_path_factory.mktemp("stage") / "forte", make.info())
    for number in range(1, N_TRIALS + 1):
        stroke = stroke_of("forte", SEED, number)
        data, table = stroke.data, None
        if number == 2:
            camera, table = film(stroke, 0.0, np.random.default_rng(1))
            data = replace(data, camera=camera)
        session.add_trial(data)
        if table is not None:
            session.write_derived("angles", number, table)
    options = ComparisonOptions.from_keywords({"keep_predictions": False, "rivals": (), "budget": False})
    tested = model_under_test(session, model.load_action(), options)
    predicted = predict_session(measure_session(session, tested.geometry_at, 6e-5), tested)
    return Stage(predicted, find_session_events(predicted, tested), tested)
