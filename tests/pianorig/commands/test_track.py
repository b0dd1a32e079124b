"""``pianorig track`` on a film without any session: table, budget, resume, a frame again, pictures."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pandas as pd
import pytest

import vision
from tests.command_line import run
from tests.vision.film.avi_file import write_avi
from tests.vision.known_films import smooth_step
from vision import Body, open_film, save_bodies, write_mraw
from vision.synthetic import Scene, Sensor, SyntheticBody, background, box, speckle


@pytest.fixture(scope="module")
def filmed(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path, np.ndarray]:
    """A bar that turns by 0.25 rad in 60 frames, its outline file, and its true angle."""
    folder = tmp_path_factory.mktemp("film")
    body = SyntheticBody("bar", box(-30.0, -22.0, 80.0, 22.0), speckle((-36.0, -28.0, 86.0, 28.0), 5))
    scene = Scene([body], background(150, 210, 6))
    angle = 0.25 * smooth_step((np.arange(60) - 14) / 36)
    sensor = Sensor(2.0, 12, 3)
    frames = [sensor.expose(scene.light(np.array([[[a, 92.0, 96.0]]]))) for a in angle]
    film, outlines = folder / "film.mraw", folder / "bodies.toml"
    write_mraw(film, frames, 2000.0, bit_depth=12, exposure_s=1e-4, start_frame=-10)
    save_bodies(outlines, [Body("bar", body.outline(0.0, 92.0, 96.0))])
    return film, outlines, angle


def test_a_film_on_its_own(
    filmed: tuple[Path, Path, np.ndarray], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    film, outlines, angle = filmed
    out, sheet, plot = (tmp_path / name for name in ("o.csv", "worst.png", "plot.png"))
    pictures = ("--contact-sheet", str(sheet), "--plot", str(plot))
    assert run("track", str(film), "--bodies", str(outlines), "--out", str(out), *pictures) == 0
    text = capsys.readouterr()
    assert "expected uncertainty in mdeg" in text.err and "not calibrated: assumed tilt 1 deg" in text.err
    assert "0 frames lost" in text.out and "synchroni" in text.out
    table = pd.read_csv(out)
    np.testing.assert_allclose(table["time_s"], (np.arange(60) - 10) / 2000.0 + 5e-5)
    error = table["bar_rad"] - (angle - angle[:14].mean())
    assert np.all(np.abs(error) < 5 * table["bar_u_rad"])
    assert np.all(table["bar_u_total_rad"] >= table["bar_u_rad"] * 0.999)
    assert table["bar_u_total_rad"].iloc[-1] > 1.1 * table["bar_u_rad"].iloc[-1], "tilt assumed"
    assert all(path.stat().st_size > 1000 for path in (sheet, plot))
    assert sorted(p.name for p in tmp_path.iterdir()) == ["o.csv", "plot.png", "worst.png"]


def test_the_shutter_is_declared_or_said_to_be_unknown(
    filmed: tuple[Path, Path, np.ndarray], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    film, outlines, _ = filmed
    line = ("track", film, "--bodies", outlines, "--out", tmp_path / "o.csv", "--every", "10")
    rolling = ("--shutter", "rolling", "--rows-per-second", "2e5")
    for declared, said in (((), "shutter not declared"), (rolling, "rolling shutter, 200000 rows/s")):
        assert run(*line, *declared) == 0
        assert said in capsys.readouterr().out
    for wrong, said in (
        (rolling[:2], "--rows-per-second"),
        (rolling[2:], "--shutter rolling"),
        (("--shutter", "slow"), "slow"),
        ((*rolling[:3], "-1"), "rows_per_s"),
    ):
        assert run(*line, *wrong) == 2
        assert said in capsys.readouterr().err


def test_three_frames_are_shown_before_the_film_is_tracked(
    filmed: tuple[Path, Path, np.ndarray], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    film, outlines, angle = filmed
    out = tmp_path / "o.csv"
    assert run("track", film, "--bodies", outlines, "--out", out, "--preview", "3") == 0
    said = [line for line in capsys.readouterr().err.splitlines() if line.startswith(("frame ", "look at"))]
    assert [line.split(",")[0] for line in said[:3]] == ["frame 20", "frame 39", "frame 59"]
    for line, true in zip(said, np.degrees(angle[[20, 39, 59]]), strict=False):
        assert float(line.split("bar ")[1].split(" deg")[0]) == pytest.approx(true, abs=0.02)
    assert "o.preview.png" in said[3]
    picture = cv2.imread(str(tmp_path / "o.preview.png"))
    assert picture.shape[1] > 3 * 350 and out.is_file()
    assert run("track", film, "--bodies", outlines, "--out", out, "--preview", "2", "--every", "20", "--json") == 0
    assert json.loads(capsys.readouterr().out)["preview"]["lost"] == {"bar": 0}


def test_frames_are_drawn_to_draw_outlines_on(
    filmed: tuple[Path, Path, np.ndarray], tmp_path: Path, refused: Callable[..., None]
) -> None:
    film, outlines, _ = filmed
    assert run("track", film, "--draw-frames", tmp_path / "frames.png") == 0
    first = cv2.imread(str(tmp_path / "frames_first.png"), cv2.IMREAD_GRAYSCALE)
    with vision.open_film(film) as source:
        np.testing.assert_array_equal(first, source.read(0) >> (source.bit_depth - 8))  # pixel by pixel
    assert cv2.imread(str(tmp_path / "frames.png")).shape[1] > first.shape[1]
    refused("leave out --bodies", "track", film, "--draw-frames", tmp_path / "f.png", "--bodies", outlines)
    refused("an outline around the point", "track", film, "--marks", tmp_path / "marks.toml")
    refused("steps through the film", "track", film, "--overlay", tmp_path / "film.avi")
    refused("draw the outlines with", "track", film, "--propose-bodies", tmp_path / "p.toml")


def test_the_rate_of_a_video_file_is_doubted(
    filmed: tuple[Path, Path, np.ndarray], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    film, outlines, _ = filmed
    with open_film(film) as source:
        write_avi(tmp_path / "f.avi", [(source.read(i) >> 4).astype(np.uint8) for i in range(30)], 25.0, quality=None)
    line = ("track", tmp_path / "f.avi", "--bodies", outlines, "--out", tmp_path / "o.csv", "--every", "6")
    assert run(*line) == 0
    assert "25 frames/s; in a video file that is often the rate of play-back" in capsys.readouterr().err
    assert run(*line, "--frame-rate", "2000") == 0
    assert "play-back" not in capsys.readouterr().err
    assert pd.read_csv(tmp_path / "o.csv")["time_s"].tolist() == pytest.approx([k * 0.003 for k in range(5)])
    assert run(*line, "--figure", tmp_path / "f.gif") == 2  # before any frame is tracked
    assert "allowed .svg, .pdf or .png" in capsys.readouterr().err


def test_a_frame_again_keeps_the_times_and_options_of_its_table(
    filmed: tuple[Path, Path, np.ndarray], tmp_path: Path, refused: Callable[..., None]
) -> None:
    film, outlines, _ = filmed
    with open_film(film) as source:
        write_avi(tmp_path / "f.avi", [(source.read(i) >> 4).astype(np.uint8) for i in range(60)], 25.0, quality=None)
    base = ("track", tmp_path / "f.avi", "--bodies", outlines, "--out", tmp_path / "o.csv")
    assert run(*base, "--every", "6", "--frame-rate", "2000") == 0
    first = pd.read_csv(tmp_path / "o.csv")
    assert run(*base, "--retrack", "24") == 0
    again = pd.read_csv(tmp_path / "o.csv")
    assert again["time_s"].tolist() == first["time_s"].tolist() == pytest.approx([k * 0.003 for k in range(10)])
    assert 1.0 < again.loc[4, "bar_u_rad"] / first.loc[4, "bar_u_rad"] < 1.5  # the motion's terms at 2000 frames/s


def test_every_nth_frame_with_json(
    filmed: tuple[Path, Path, np.ndarray], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    film, outlines, _ = filmed
    out = tmp_path / "o.csv"
    options = ("--every", "5", "--tilt", "0", "--distortion", "0", "--json")
    assert run("track", str(film), "--bodies", str(outlines), "--out", str(out), *options) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["frames"] == 12 and facts["lost"] == {"bar": 0}
    budget = facts["budget_rad"]["bar"]
    assert max(budget["tilt"], budget["distortion"], budget["codec"]) < 1e-15
    assert budget["noise"] > budget["reference"] > 0 and budget["shutter"] > 0
    parts = sum(budget[name] ** 2 for name in budget if name != "total")
    assert budget["total"] == pytest.approx(parts**0.5)
    assert pd.read_csv(out)["frame"].tolist() == list(range(0, 60, 5))


def test_a_frame_again(filmed: tuple[Path, Path, np.ndarray], tmp_path: Path, refused: Callable[..., None]) -> None:
    film, outlines, angle = filmed
    out = tmp_path / "o.csv"
    base = ("track", str(film), "--bodies", str(outlines), "--out", str(out))
    assert run(*base) == 0
    table = pd.read_csv(out)
    good = table.copy()
    table.loc[33, ["bar_rad", "bar_x_px", "bar_y_px"]] = np.nan
    table.loc[33, "bar_flag"] = 1
    table.to_csv(out, index=False)
    assert run(*base, "--retrack", "33") == 0
    mended = pd.read_csv(out)
    assert abs(mended.loc[33, "bar_rad"] - good.loc[33, "bar_rad"]) < 0.2 * good.loc[33, "bar_u_rad"]
    pd.testing.assert_frame_equal(mended.drop(index=33), good.drop(index=33))
    row = good.loc[40]
    near = f"bar={np.degrees(row['bar_rad']) + 1.5},{row['bar_x_px'] + 2},{row['bar_y_px'] - 2}"
    assert run(*base, "--retrack", "40", "--place", near) == 0
    assert abs(pd.read_csv(out).loc[40, "bar_rad"] - row["bar_rad"]) < 0.2 * row["bar_u_rad"]
    for wrong, words in (
        (("--retrack", "60"), "no such frame"),
        (("--retrack", "3", "--place", "bar=1,2"), "ANGLE_DEG"),
        (("--retrack", "3", "--place", "beam=1,2,3"), "beam"),
        (("--place", "bar=1,2,3"), "--retrack"),
        (("--retrack", "3", "--figure", "f.png"), "--retrack: fits single frames only; leave out --figure"),
    ):
        refused(words, *base, *wrong)


def test_interrupted_by_the_user(
    filmed: tuple[Path, Path, np.ndarray],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Ctrl-C in frame 45: no table, what is done is kept, the same command goes on."""
    import vision.tracking.passes
    from vision.tracking.film_tracker import FilmTracker

    film, outlines, _ = filmed
    out = tmp_path / "o.csv"
    base = ("track", str(film), "--bodies", str(outlines), "--out", str(out))
    monkeypatch.setattr(vision.tracking.passes, "EVERY_ROWS", 20)
    fit_frame = FilmTracker.fit_frame

    def stop(self: FilmTracker, index: int, *rest: object, **more: object) -> None:
        if index == 45:
            raise KeyboardInterrupt
        fit_frame(self, index, *rest, **more)

    with monkeypatch.context() as patch:
        patch.setattr(FilmTracker, "fit_frame", stop)
        assert run(*base) == 130
    assert [p.name for p in tmp_path.iterdir()] == ["o.csv.unfinished.npz"]
    capsys.readouterr()
    assert run(*base) == 0
    assert "40 from an interrupted run" in capsys.readouterr().out
    assert [p.name for p in tmp_path.iterdir()] == ["o.csv"]


def test_film_without_a_frame_rate(
    filmed: tuple[Path, Path, np.ndarray], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    film, outlines, _ = filmed
    folder = tmp_path / "pictures"
    folder.mkdir()
    with open_film(film) as source:
        for i in range(30):
            assert cv2.imwrite(str(folder / f"f{i}.png"), source.read(i) << 4)
    out = tmp_path / "o.csv"
    base = ("track", str(folder), "--bodies", str(outlines), "--out", str(out))
    assert run(*base) == 2
    assert "--frame-rate" in capsys.readouterr().err
    assert run(*base, "--frame-rate", "4000") == 0
    np.testing.assert_allclose(pd.read_csv(out)["time_s"], np.arange(30) / 4000.0)
    assert run(*base, "--frame-rate", "0") == 2
