"""Outlines over HTTP: saved as tracking reads them, refused with the reason; the worst frames; films on their own."""

from __future__ import annotations

import os
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vision
from rig import Session
from tests.command_line import run
from tests.pianorig.page.conftest import FIRST_FRAME, FRAMES, HEIGHT, WIDTH, Page
from vision import write_mraw

HERE = "/api/outlines/example_forte/1"
SQUARE = [[10, 8], [40, 8], [40, 50], [10, 50]]


def body(**other: Any) -> dict[str, Any]:
    return {"name": "jack", "parent": "", "layer": 0, "points": SQUARE, **other}


def test_what_is_there_and_the_worst_frames(filmed: Path, looking: Page) -> None:
    found = looking.ask(HERE).json
    assert [row["name"] for row in found["outlines"]] == ["whippen", "jack", "repetition"]
    assert found["film"]["n_frames"] == FRAMES and found["file"] == "bodies.toml"
    assert found["worst"] == []  # the stored angles say nothing of correlation
    session = filmed / "example_forte"
    table, _ = Session.open(session).read_derived("angles", 1)
    for name in ("whippen", "jack", "repetition"):
        table[f"{name}_quality"] = np.where(table["frame"] == 90, 0.7, 0.99)
    Session.open(session).write_derived("angles", 1, table, {}, {})
    worst = looking.ask(HERE).json["worst"]
    assert worst[0]["frame"] == 60 and "whippen lost: " in worst[0]["words"]
    assert worst[1] == {"frame": 90, "words": "whippen correlates 0.700"}


def test_outlines_are_saved_as_tracking_reads_them(filmed: Path, writing: Page) -> None:
    old = (filmed / "example_forte" / "bodies.toml").read_text()
    points = [[60.5, 8.0], [100, 8], [100, 50.25], [60, 50]]
    sent = [body(name="whippen"), body(name='a "b"', parent="whippen", layer=2, points=points)]
    answer = writing.ask(HERE, "POST", {"bodies": sent})
    assert answer.status == 200 and answer.json["bodies"] == ["whippen", 'a "b"']
    read = vision.load_bodies(filmed / "example_forte" / "bodies.toml")
    assert [(one.name, one.parent, one.layer) for one in read] == [("whippen", None, 0), ('a "b"', "whippen", 2)]
    np.testing.assert_array_equal(read[1].polygon_px, points)
    assert (filmed / "example_forte" / "bodies.previous.toml").read_text() == old  # nothing is lost


@pytest.mark.parametrize(
    ("bodies", "words"),
    [
        ([], "1 to 32"),
        ("x", "1 to 32"),
        ([3], "table of name"),
        ([body(name="")], "non-empty"),
        ([body(name="x" * 61)], "60 characters"),
        ([body()] * 32, "used 32 times"),
        ([body(parent="nobody")], "not among"),
        ([body(layer=1.5)], "whole number"),
        ([body(points=SQUARE[:2])], "m >= 3"),
        ([body(points=[[0, 0], [1, 1], ["a", 2]])], "pairs of numbers"),
        ([body(points=[[0, 0], [1, 1], [None, 2]])], "jack"),
        ([body(points=[[10, 8], [14, 8], [14, 12]])], "usable pixels"),
        ([body(points=SQUARE * 200)], "up to 500"),
    ],
)
def test_what_is_no_outline_is_refused_and_nothing_is_written(shown: Page, bodies: Any, words: str) -> None:
    before = (shown.folder / "example_forte" / "bodies.toml").read_bytes()
    answer = shown.ask(HERE, "POST", {"bodies": bodies})
    assert answer.status == 400 and words in answer.json["error"] and "\n" not in answer.json["error"]
    assert (shown.folder / "example_forte" / "bodies.toml").read_bytes() == before


def test_a_film_on_its_own_has_its_files_beside_it(filmed: Path, writing: Page) -> None:
    for ending in (".mraw", ".cihx"):
        shutil.copy(filmed / "example_forte" / f"trial_0001{ending}", filmed / f"foreign{ending}")
    (filmed / "not a film.txt").write_text("")
    (filmed / "folder.mraw").mkdir()
    os.symlink("/nowhere", filmed / "dangling.avi")
    assert writing.ask("/api/films").json == {"films": ["foreign.mraw"]}
    found = writing.ask("/api/outlines/foreign.mraw/0").json
    assert found["outlines"] == [] and found["worst"] == [] and found["film"]["n_frames"] == FRAMES
    assert writing.ask("/film/foreign.mraw/0/3-2").status == 200
    refused = writing.ask("/api/outlines/foreign.mraw/0/track", "POST", {})
    assert refused.status == 400 and "save them first" in refused.json["error"]
    assert writing.ask("/api/outlines/foreign.mraw/0", "POST", {"bodies": [body()]}).status == 200
    assert (filmed / "foreign.bodies.toml").is_file()
    (filmed / "foreign.angles.csv").write_text("")
    refused = writing.ask("/api/outlines/foreign.mraw/0")
    assert refused.status == 400 and "cannot be read" in refused.json["error"] and "track" in refused.json["error"]
    for rate in (0, -1, "x", True, 1e10):
        answer = writing.ask("/api/outlines/foreign.mraw/0/track", "POST", {"frame_rate_hz": rate})
        assert answer.status == 400 and "frame rate" in answer.json["error"], rate
    for name in ("..%2fx.mraw", "folder.mraw", "dangling.avi", "example_forte"):
        assert writing.ask(f"/api/outlines/{name}/0").status == 404, name


def test_a_place_that_is_none_is_refused(shown: Page) -> None:
    for content, words in (
        ({"frame": "1", "places": {}}, "frame number"),
        ({"frame": 1, "places": {"jack": [1, 2]}}, "place of jack"),
        ({"frame": 1, "places": {"jack": [1, 2, None]}}, "place of jack"),
        ({"frame": 1, "places": {"j" * 90: []}}, f"place of {'j' * 60}: allowed"),
        ({"frame": 1, "places": {"jack": [0.0, 1.0, 2.0]}}, "track the film first"),
    ):
        answer = shown.ask(f"{HERE}/frame", "POST", content)
        assert answer.status == 400 and words in answer.json["error"], words


def test_a_frame_is_fitted_again_as_its_film_was_tracked(filmed: Path, writing: Page) -> None:
    session = filmed / "example_forte"
    film, random = session / "trial_0001.mraw", np.random.default_rng(2)
    picture = np.kron(random.uniform(40, 200, (HEIGHT // 4, WIDTH // 4)), np.ones((4, 4)))
    frames = (picture + random.standard_normal((FRAMES, HEIGHT, WIDTH))).astype(np.uint8)
    write_mraw(film, frames, 2000.0, exposure_s=1e-4, start_frame=FIRST_FRAME)
    sent = {"frame": 30, "places": {}}
    assert run("track", film, "--every", "10", "--out", film.with_suffix(".angles.csv")) == 0
    before, stated = Session.open(session).read_derived("angles", 1)
    assert writing.ask(f"{HERE}/frame", "POST", sent).status == 200
    after, again = Session.open(session).read_derived("angles", 1)
    assert stated["every"] == again["every"] == 10 and again["retracked_frames"] == "30"
    np.testing.assert_array_equal(after["time_s"], before["time_s"])
    assert writing.ask(f"{HERE}/frame", "POST", {**sent, "frame": 20}).status == 200
    assert Session.open(session).read_derived("angles", 1)[1]["retracked_frames"] == "20, 30"
    for option in ("--tilt", "2"), ("--shutter", "global"):
        assert run("track", film, *option, "--every", "30", "--out", film.with_suffix(".angles.csv")) == 0
        answer = writing.ask(f"{HERE}/frame", "POST", sent)
        assert answer.status == 400 and "options of the first tracking" in answer.json["error"]
