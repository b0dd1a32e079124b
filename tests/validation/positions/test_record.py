"""The identified set as a file: what is written is read, anything else is refused in one line."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest

from tests.validation.positions.test_measured import trial
from validation.errors import ValidationInputError
from validation.infer.positions import MODELS, Identified, read_identified, sensors_of, write_identified
from validation.measurement.positions import measure_stroke
from validation.prediction.positions import NAMES, SENSORS, Mixture
from validation.statistics.bands import PredictionBand

N, M = len(NAMES), len(SENSORS)
STROKE = measure_stroke(trial())
BANDS = {name: PredictionBand(0.02, True, "pooled", {"rest": 2.0}, {"2": {"inside": 0.9}}) for name in MODELS}
SET = Identified(
    "hirschkorn2004-regulated", "here", {"2": "ab"}, sensors_of(STROKE), NAMES, [0.1] * N, np.eye(N).tolist(),
    NAMES[:M], [0.0] * M, np.eye(M).tolist(), {"before": 9.0, "after": 1.0, "null": 5.0}, BANDS,
    Mixture([[0.1] * N, [0.2] * N], [0.7, 0.3]),
    {"identified": {"2": Mixture.of_one(np.zeros(N))}},
)  # fmt: skip


def test_round_trip(tmp_path) -> None:
    write_identified(tmp_path / "identified.json", SET)
    assert read_identified(tmp_path) == SET == read_identified(tmp_path / "identified.json")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("nonsense", "not JSON"),
        ("[1]", "not an identified set"),
        (json.dumps({"schema": "other"}), "not an identified set"),
        (json.dumps({"schema": "piano-action-rig identified positions 3"}), "a field is missing"),
    ],
)
def test_another_file_is_refused(tmp_path, text, said) -> None:
    (tmp_path / "identified.json").write_text(text)
    with pytest.raises(ValidationInputError, match=said):
        read_identified(tmp_path)


def test_other_parameters_are_refused(tmp_path) -> None:
    write_identified(tmp_path / "identified.json", dataclasses.replace(SET, names=(*NAMES[1:], "more")))
    with pytest.raises(ValidationInputError, match="not those of this version"):
        read_identified(tmp_path)


def test_a_missing_file_is_named(tmp_path) -> None:
    with pytest.raises(ValidationInputError, match="cannot be read"):
        read_identified(tmp_path / "none.json")


def test_other_sensors_are_refused() -> None:
    SET.check((STROKE,), "here")
    other = dataclasses.replace(SET, sensors={**SET.sensors, "key sensor": "front"})
    with pytest.raises(
        ValidationInputError, match="trial 1: key sensor is 'there', the identified set holds for 'front'"
    ):
        other.check((STROKE,), "here")
