"""A trial under the cursor: the report's numbers, frames as they are in the film, outlines where they were found."""

from __future__ import annotations

import base64
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import model
from pianorig.page.review import trial_view
from rig import Session
from tests.pianorig.page.conftest import FRAMES, HEIGHT, WIDTH, Page, film_frames
from validation.measurement.trial import measure
from validation.prediction.model_under_test import ModelUnderTest
from vision import write_mraw

TRIAL = "/api/review/example_forte/1"


def numbers(packed: dict[str, Any]) -> np.ndarray:
    return np.frombuffer(base64.b64decode(packed["f32"]), "<f4").reshape(packed["shape"]).astype(float)


@pytest.fixture(scope="module")
def view() -> dict[str, Any]:
    root = Path(__file__).parents[3] / "sessions" / "example_forte"
    return trial_view(Session.open(root), 1, ["hirschkorn2004", "hirschkorn2004-regulated"])


def test_curves_and_residuals_are_one_set_of_numbers(view: dict[str, Any]) -> None:
    data = Session.open(Path(__file__).parents[3] / "sessions" / "example_forte").trial(1).read()
    tested = ModelUnderTest(model.load_action("hirschkorn2004"))
    measured = measure(data, None, tested.geometry_at(data.force_info.preload_n))
    assert view["models"] == ["hirschkorn2004", "hirschkorn2004-regulated"]
    np.testing.assert_allclose(numbers(view["force"]["value"]), measured.force.force_n, atol=1e-5)
    np.testing.assert_allclose(numbers(view["force"]["time_s"]), measured.force.time_s, atol=1e-6)
    for body, i, sign in (("key", 0, -1.0), ("whippen", 1, 1.0), ("hammer", 2, -1.0)):
        channel = view["channels"][body]
        shown = numbers(channel["measured"]["value"])
        np.testing.assert_allclose(shown, sign * np.degrees(measured.change_rad[:, i]), atol=1e-5)
        for line, residual in zip(channel["models"], channel["residuals"], strict=True):
            np.testing.assert_allclose(numbers(residual["value"]), numbers(line["value"]) - shown, atol=1e-4)
    assert view["channels"]["jack"]["measured"] is None and view["channels"]["jack"]["residuals"] == []
    # the two models differ, and each is its own curve
    first, second = (numbers(line["value"]) for line in view["channels"]["hammer"]["models"])
    assert np.nanmax(np.abs(first - second)) > 0.1


def test_events_are_moments_of_trial_and_model_in_order(view: dict[str, Any]) -> None:
    times = [event["time_s"] for event in view["events"]]
    assert times == sorted(times) and {event["source"] for event in view["events"]} == {"measured", "model"}
    impacts = {event["source"]: event["time_s"] for event in view["events"] if event["name"] == "string_impact"}
    hammer = view["channels"]["hammer"]
    peak = numbers(hammer["measured"]["time_s"])[np.argmax(numbers(hammer["measured"]["value"]))]
    assert impacts["measured"] == pytest.approx(peak, abs=3e-3) and impacts["model"] == pytest.approx(peak, abs=6e-3)
    assert not any(event["name"] in ("hammer_speed", "check_height") for event in view["events"])


def test_the_drawing_moves_as_the_curves_do(view: dict[str, Any]) -> None:
    drawing = view["drawings"][0]
    assert len(view["drawings"]) == len(view["models"])
    times, pose, measured = (numbers(drawing[name]) for name in ("time_s", "pose", "measured"))
    names = [body["name"] for body in drawing["bodies"]]
    assert names == ["key", "whippen", "jack", "repetition", "hammer"] and pose.shape == (times.size, 5, 3)
    for body, sign in (("key", -1.0), ("whippen", 1.0), ("hammer", -1.0)):
        i = names.index(body)
        for drawn, curve in (
            (pose, view["channels"][body]["models"][0]),
            (measured, view["channels"][body]["measured"]),
        ):
            turned = sign * np.degrees(drawn[:, i, 2] - drawn[0, i, 2])
            wanted = np.interp(times, numbers(curve["time_s"]), numbers(curve["value"]))
            known = np.isfinite(wanted)
            np.testing.assert_allclose(turned[known], (wanted - wanted[0])[known], atol=0.02, err_msg=body)
    assert np.isnan(measured[:, names.index("jack")]).all()  # not measured, so not drawn as if it were
    # the jack is carried: its pivot goes with the whippen
    assert np.ptp(pose[:, names.index("jack"), 1]) > 1e-3 and np.ptp(pose[:, names.index("whippen"), 1]) == 0.0
    force = numbers(drawing["normal_n"])
    assert force.shape == (times.size, len(drawing["contacts"])) and force.max() > 5.0 and force.min() >= 0.0


def test_looking_writes_nothing(filmed: Path, looking: Page) -> None:
    def files() -> dict[Path, tuple[int, int]]:
        found = (path for path in filmed.rglob("*") if path.is_file())
        return {path: (path.stat().st_size, path.stat().st_mtime_ns) for path in found}

    before = files()
    answer = looking.ask(TRIAL)
    assert answer.status == 200 and answer.json["models"] == ["hirschkorn2004"]
    jack = answer.json["channels"]["jack"]
    assert jack["measured"] is not None and len(jack["residuals"]) == 1
    assert looking.ask("/api/film/example_forte/1").status == 200
    assert files() == before


def test_frames_are_those_of_the_film(shown: Page) -> None:
    truth = film_frames()
    for first, count, found in ((0, 1, 1), (37, 8, 8), (FRAMES - 3, 8, 3)):
        answer = shown.ask(f"/film/example_forte/1/{first}-{count}?v=1")
        assert answer.status == 200 and "max-age" in answer.headers["Cache-Control"]
        got = np.frombuffer(answer.body, np.uint8).reshape(-1, HEIGHT, WIDTH)
        np.testing.assert_array_equal(got, truth[first : first + count])
        assert len(got) == found
    for address in (f"1/{FRAMES}-1", "1/99999999-1", "2/0-1", "9/0-1"):
        answer = shown.ask(f"/film/example_forte/{address}")
        assert answer.status == 404 and "\n" not in answer.json["error"], address
    for count in (0, 17):
        assert shown.ask(f"/film/example_forte/1/0-{count}").status == 400
    assert shown.ask("/film/..%2fexample_forte/1/0-1").status == 404


def test_of_a_deep_film_the_upper_bits_are_shown(filmed: Path, looking: Page) -> None:
    deep = (film_frames()[:10].astype(np.uint16) << 4) + 7
    write_mraw(filmed / "example_forte" / "trial_0001.mraw", deep, 2000.0, exposure_s=1e-4, bit_depth=12)
    got = np.frombuffer(looking.ask("/film/example_forte/1/0-10").body, np.uint8).reshape(10, HEIGHT, WIDTH)
    np.testing.assert_array_equal(got, film_frames()[:10])


def test_outlines_stand_where_tracking_found_them(filmed: Path, looking: Page) -> None:
    film = looking.ask("/api/film/example_forte/1").json["film"]
    assert (film["n_frames"], film["height"], film["width"], film["note"]) == (FRAMES, HEIGHT, WIDTH, "")
    clock = Session.open(filmed / "example_forte").trial(1).read().camera.frame_time_s[800 : 800 + FRAMES]
    np.testing.assert_array_equal(film["time_s"], clock)
    body = film["bodies"][0]
    assert body["name"] == "whippen" and [i for i, lost in enumerate(body["lost"]) if lost] == [60]
    turn = numbers(body["turn"])
    assert turn[100] == pytest.approx(-0.1) and np.isnan(turn[60])  # picture axes: y down, so the sign flips
    # at rest the outline lies where it was drawn
    moved = np.array(body["points"]) + [numbers(body["x"])[0], numbers(body["y"])[0]]
    np.testing.assert_allclose(moved, [[6, 8], [36, 8], [36, 52], [6, 52]], atol=0.6)
    text = (filmed / "example_forte" / "bodies.toml").read_text()
    (filmed / "example_forte" / "bodies.toml").write_text(text.replace("36", "37"))
    assert "bodies.toml" in looking.ask("/api/film/example_forte/1").json["film"]["note"]
    (filmed / "example_forte" / "bodies.toml").write_text("x")
    film = looking.ask("/api/film/example_forte/1").json["film"]
    assert film["bodies"] == [] and "cannot be drawn" in film["note"]


def test_a_film_that_cannot_be_read_leaves_the_curves(filmed: Path, looking: Page) -> None:
    (filmed / "example_forte" / "trial_0001.cihx").write_text("<cih>")
    found = looking.ask("/api/film/example_forte/1").json
    assert found["film"] is None and "film:" in found["error"] and "\n" not in found["error"]
    assert looking.ask("/film/example_forte/1/0-1").status == 404
    assert looking.ask("/api/film/example_forte/2").json == {"film": None, "error": None}


def test_a_trial_that_cannot_be_compared_is_shown_as_recorded(folder: Path, looking: Page) -> None:
    from dataclasses import replace

    session = Session.open(folder / "example_forte")
    data = session.trial(1).read()
    few = {"encoders": data.encoders[:1], "encoder_count": data.encoder_count[:, :1]}
    session.add_trial(replace(data, number=7, status="interrupted", reason="stop <pressed>", sha256="", **few))
    found = looking.ask("/api/review/example_forte/7").json
    assert any("shown as recorded" in note and "whippen" in note for note in found["notes"])
    assert any("stop <pressed>" in note for note in found["notes"])
    assert list(found["channels"]) == ["key"] and found["models"] == [] and found["drawings"] == []
    np.testing.assert_allclose(numbers(found["force"]["value"]), data.raw_force_n, atol=1e-5)


@pytest.mark.parametrize("name", ["../../etc/passwd", "nothing", "rig.toml", ""])
def test_only_built_in_models_are_read(shown: Page, name: str) -> None:
    answer = shown.ask(f"{TRIAL}?model={name}&model=x")
    assert answer.status == 400 and "hirschkorn2004" in answer.json["error"]


def test_the_animation_to_keep_shows_measured_beside_model(shown: Page) -> None:
    text = shown.ask("/api/review/example_forte/1/animation?model=hirschkorn2004").json["text"]
    data = json.loads(text.split('id="data">')[1].split("</script>")[0])
    view = shown.ask("/api/review/example_forte/1?model=hirschkorn2004").json
    assert data["drawings"][0]["drawing"] == view["drawings"][0]
    hammer = next(curve for curve in data["curves"] if curve["title"].startswith("hammer"))
    assert hammer["value"] == view["channels"]["hammer"]["measured"]["value"]
    assert hammer["beside"] == view["channels"]["hammer"]["models"][0]
    onset = next(event for event in view["events"] if event["name"] == "onset")
    assert onset["time_s"] - 0.05 < data["start_s"] < onset["time_s"] and data["events"] == view["events"]
    assert shown.ask("/api/review/example_forte/9/animation").status == 400
    assert shown.ask("/api/review/example_forte/1/animation?model=../x").status == 400
