"""Strokes of the kinds that are kept aside, simulated and seen by the sensors: cut, counted, measured, predicted."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import rig
from tests.validation.positions.planted import (
    KEPT_ASIDE,
    OFF,
    SHIPPED,
    Truth,
    compare,
    identified_specimen,
    write_recording,
)
from validation.events.strikes import RELEASE, STRIKE, find_phases, find_stroke_events
from validation.measurement.positions import Stroke, measure_positions


@pytest.fixture(scope="module")
def seen(tmp_path_factory) -> dict[str, tuple[Truth, Stroke]]:
    """One stroke, eight repetitions, a slide-off, in one recording through sensors with drift, hum and noise."""
    return recorded(tmp_path_factory.mktemp("planted"), KEPT_ASIDE)


def recorded(folder: Path, kinds: tuple[str, ...], exact: bool = False) -> dict[str, tuple[Truth, Stroke]]:
    """Truth and what is measured of one recording of these kinds of stroke."""
    truths = write_recording(folder / "r.csv", identified_specimen(seed=3), kinds, exact)
    session = rig.import_session(folder / "s", [folder / "r.csv"], rig.load_mapping(SHIPPED / "mapping.toml"))
    strokes, refused = measure_positions(session)
    assert not refused and len(strokes) == len(truths)
    return {truth.kind: (truth, stroke) for truth, stroke in zip(truths, strokes, strict=True)}


def test_each_is_one_trial_and_each_note_a_strike(seen) -> None:
    strikes = {kind: len(find_stroke_events(stroke, stroke.hammer.value_m)) for kind, (_, stroke) in seen.items()}
    assert strikes == {"fast": 1, "repetitions": 8, "slide-off": 1}


def test_a_hammer_that_strikes_again_comes_back_only_part_way(tmp_path) -> None:
    truth, stroke = recorded(tmp_path, ("repetitions",), exact=True)["repetitions"]
    found = find_stroke_events(stroke, stroke.hammer.value_m)
    tops, backs = (np.array([one[name] for one in found]) for name in ("top_m", "back_m"))
    assert np.all(tops > 0.95 * stroke.hammer.travel_m)  # each note reaches the stop
    impacts = np.array([one["impact_s"] for one in found])
    first = truth.time_s[np.argmax(truth.hammer_m > 0.995 * truth.hammer_m.max())]
    edges = np.searchsorted(truth.time_s, first + impacts - impacts[0])
    lowest = [truth.hammer_m[a:b].min() for a, b in zip(edges, edges[1:], strict=False)]
    assert backs[:-1] == pytest.approx(lowest, abs=2e-5) and np.isnan(backs[-1])
    assert np.sum(backs[:-1] > 0.15 * stroke.hammer.travel_m) >= 2  # quick ones, which do not come home
    key = stroke.key.value_m / stroke.key.value_m.max()
    assert key[find_phases(stroke) == RELEASE].min() < 0.2 and np.all(np.diff([one["impact_s"] for one in found]) > 0.1)


def test_a_key_let_go_early_is_released_at_once_and_its_strike_has_an_impact(seen) -> None:
    truth, stroke = seen["slide-off"]
    (found,) = find_stroke_events(stroke, stroke.hammer.value_m)
    assert found["top_m"] > 0.95 * stroke.hammer.travel_m and np.isnan(found["check_m"])
    at = find_phases(stroke)
    struck = np.flatnonzero(at == STRIKE)
    assert np.ptp(stroke.time_s[struck[struck < np.argmax(at == RELEASE)]]) < 0.12
    assert truth.hammer_m.max() == pytest.approx(found["top_m"], abs=1e-4)


def test_the_speed_before_the_impact_is_seen_without_bias(seen) -> None:
    ratio = [find_stroke_events(s, s.hammer.value_m)[0]["speed_m_per_s"] / truth.speed() for truth, s in seen.values()]
    assert np.all(np.abs(np.array(ratio) - 1.0) < 0.15)  # the rulers: two readings off by an eighth of a tick each
    assert np.ptp(ratio) < 0.06  # and the same in every stroke


def test_the_shipped_band_holds_a_stroke_of_another_day(tmp_path) -> None:
    _, found = compare(identified_specimen(OFF, seed=5), ("fast",), tmp_path)
    scores = found.scores.set_index("model")
    assert scores.loc["identified", "inside_band"] > 0.9
    for name in ("rmse_share", "interval_score_share"):
        assert scores.loc["identified", name] < scores.loc["null", name]
    assert scores.loc["identified", "rmse_share"] < scores.loc["regulated", "rmse_share"]
