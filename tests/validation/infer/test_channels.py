"""Errors of channels: what an encoder reads with one, and what a search runs for it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import model
from tests.validation.infer import toy
from validation.infer.blocks import INSTRUMENT
from validation.infer.causes.responses import Point, Responses
from validation.infer.channels import CHANNEL_ERRORS, ERROR_BY_NAME, SCALE, ZERO, error_shape
from validation.infer.hypotheses import ALL, ONE, STEP, TREND, sources
from validation.prediction.model_under_test import ModelUnderTest

ACTION = model.load_action()
TURN = np.array([0.0, 1e-3, 0.02, 0.3, 0.2])


def test_shapes_of_errors_are_those_of_their_definitions() -> None:
    assert error_shape(SCALE, TURN) == pytest.approx(TURN)
    assert error_shape(ZERO, TURN) == pytest.approx([0.0, 1 - np.exp(-1.0), 1.0, 1.0, 1.0], abs=1e-8)


def test_an_error_of_an_encoder_has_one_name_in_the_fit_and_in_the_search() -> None:
    shared = [e for e in CHANNEL_ERRORS if e.kind in (SCALE, ZERO)]
    assert len(shared) == 6 and {e.name for e in shared} <= set(INSTRUMENT)
    listed = {s.name: s for s in sources(ACTION, toy.short_forte(0.05)) if s.error}
    assert list(listed) == [e.name for e in CHANNEL_ERRORS] == list(ERROR_BY_NAME)
    assert listed["key encoder delay"].profiles == listed["force gain"].profiles == (ALL, ONE, TREND, STEP)


@pytest.mark.parametrize("encoder", [0, 2])
def test_a_search_reads_the_run_with_errors_of_one_encoder_alone(encoder: int) -> None:
    name, seen = ("key", "whippen", "hammer")[encoder], toy.short_forte(0.05)
    listed = [s for s in sources(ACTION, seen) if s.name.startswith(f"{name} encoder")]
    responses = Responses(ModelUnderTest(ACTION), [seen], listed)
    base = responses.base
    assert base is not None
    turned = -base[0].reshape(3, -1)
    for i, candidate in enumerate(responses.candidates):
        source = listed[candidate.source]
        (found,) = responses.differences([Point(((i, 1.5),))])
        assert found is not None and source.error is not None
        read = -found[0].reshape(3, -1)
        others = np.arange(3) != encoder
        assert read[others] == pytest.approx(turned[others], abs=1e-12)
        if source.unit == "s":
            earlier = Responses(ModelUnderTest(ACTION), [replace(seen, time_s=seen.time_s - 1.5e-3)], listed).base
            assert earlier is not None
            assert read[encoder] == pytest.approx(-earlier[0].reshape(3, -1)[encoder], abs=1e-6)
        elif source.unit == "rad":
            shape = error_shape(source.error.kind, turned[encoder])
            assert read[encoder] - turned[encoder] == pytest.approx(1.5e-3 * shape, abs=1e-12)
        else:
            assert read[encoder] == pytest.approx(np.exp(0.05 * 1.5) * turned[encoder], abs=1e-12)
        (column,) = responses.columns([(Point(), 0, candidate.source)], [base])
        (near,) = responses.differences([Point(((i, 0.05),))])
        assert near is not None
        change = (base - near)[0] / 0.05
        assert np.linalg.norm(column - change) < 0.05 * np.linalg.norm(change)
