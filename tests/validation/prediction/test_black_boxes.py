"""Black boxes: found again where the answer is one, chosen by strokes left out, kept in a file, silent in one line."""

from __future__ import annotations

import json

import numpy as np
import pytest

from validation import ValidationInputError
from validation.prediction.black_boxes import (
    FIR,
    FIR_LAGS,
    KINDS,
    POLYNOMIAL,
    BlackBox,
    Example,
    fit_black_boxes,
    left_out_boxes,
)

TIME_S = np.arange(0.0, 1.0, 5e-4)


def press(depth, rise_s):
    at = np.array([0.1, 0.1 + rise_s, 0.6, 0.6 + 2 * rise_s])
    return np.interp(TIME_S, at, [0.0, depth, depth, 0.0])


def example(depth, rise_s, of):
    drive = press(depth, rise_s)
    return Example(TIME_S, drive, TIME_S, np.column_stack([of(drive), 2.0 * of(drive)]))


def late(drive):
    """The square of what was pressed over the 16 ms before."""
    summed = np.concatenate([np.zeros(32), np.cumsum(drive)])
    return ((summed[32:] - summed[:-32]) / 32) ** 2


STROKES = [(1.0, 0.05), (0.8, 0.08), (0.9, 0.03), (1.1, 0.06)]


def rms(box, one):
    return np.sqrt(np.mean((box.answers(one.drive_s, one.drive, one.time_s) - one.answers) ** 2)) / np.ptp(one.answers)


def test_a_static_answer_is_a_polynomial_and_a_late_one_is_not():
    new = (0.95, 0.04)
    static = fit_black_boxes([example(*s, lambda x: x**3) for s in STROKES])
    assert rms(static[POLYNOMIAL], example(*new, lambda x: x**3)) < 0.005
    boxes = fit_black_boxes([example(*s, late) for s in STROKES])
    assert rms(boxes[FIR], example(*new, late)) < 0.01 < rms(boxes[POLYNOMIAL], example(*new, late))
    assert boxes[FIR].order[1] >= 2  # a square


def test_a_product_of_lags_is_the_plain_filter():
    def echo(drive):
        lagged = {lag: np.interp(TIME_S - 1e-3 * lag, TIME_S, drive) for lag in (4, 64)}
        return lagged[4] * lagged[64] + 0.3 * lagged[64]

    boxes = fit_black_boxes([example(*s, echo) for s in STROKES])
    new = example(0.95, 0.04, echo)
    assert boxes[FIR_LAGS].order == (6, 2)  # six lags to 64 ms; the degree by strokes left out
    assert rms(boxes[FIR_LAGS], new) < 0.003 < rms(boxes[POLYNOMIAL], new)
    linear = fit_black_boxes([example(*s, lambda x: np.interp(TIME_S - 8e-3, TIME_S, x)) for s in STROKES])
    assert rms(linear[FIR_LAGS], example(0.95, 0.04, lambda x: np.interp(TIME_S - 8e-3, TIME_S, x))) < 0.003


def test_each_stroke_is_answered_by_boxes_that_have_not_seen_it():
    odd = example(1.0, 0.05, lambda x: -x)
    boxes = left_out_boxes([odd, *(example(*s, lambda x: x) for s in STROKES)])
    assert rms(boxes[0][POLYNOMIAL], odd) > 1.0  # the others say the opposite
    assert left_out_boxes([odd]) == [{}]
    many = left_out_boxes([example(1.0 + 0.01 * k, 0.05, late) for k in range(19)])  # in groups
    assert len(many) == 19 and all(set(one) == set(KINDS) for one in many)


def test_answers_stay_within_what_was_fitted_and_an_unknown_channel_is_unknown():
    known = [example(*s, late) for s in STROKES]
    lost = [Example(e.drive_s, e.drive, e.time_s, e.answers * [1.0, np.nan]) for e in known]
    for box in fit_black_boxes(lost).values():
        made = box.answers(TIME_S, press(5.0, 0.01), TIME_S)
        assert made[:, 0].max() <= max(e.answers[:, 0].max() for e in known) and np.isnan(made[:, 1]).all()


def test_a_file_holds_a_box_and_a_damaged_one_is_one_line():
    one = example(*STROKES[0], late)
    for box in fit_black_boxes([example(*s, late) for s in STROKES]).values():
        plain = json.loads(json.dumps(box.to_plain_values()))
        assert rms(BlackBox.from_plain_values(plain, "f"), one) == pytest.approx(rms(box, one), rel=1e-3, abs=1e-5)
        for change in ({"weights": plain["weights"][1:]}, {"kind": "net"}, {"order": [3, 9]}, {"low": None}):
            with pytest.raises(ValidationInputError, match=r"^f: black box found .* again$"):
                BlackBox.from_plain_values(plain | change, "f")
    with pytest.raises(ValidationInputError, match="found no stroke"):
        fit_black_boxes([])
