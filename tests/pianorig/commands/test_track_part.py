"""``track --from``, ``--to``: a part of a film, whose frames keep their numbers and their times."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from tests.command_line import run
from tests.vision.turning_bar import OUTLINES, smooth_turn, turning_bar, write_video
from vision import write_mraw


@pytest.fixture(scope="module")
def film(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A bar at rest from frame 6 on, turning from 21; six dark frames before; frame 0 is the 30th before a trigger."""
    frames = turning_bar(smooth_turn(np.arange(60)))
    frames = np.concatenate([np.full((6, *frames.shape[1:]), 3, np.uint8), frames])
    folder = tmp_path_factory.mktemp("film")
    write_mraw(folder / "film.mraw", frames, 2000.0, start_frame=-30)
    (folder / "b.toml").write_text(OUTLINES)
    return folder / "film.mraw"


def test_a_part_of_a_film_is_tracked_as_the_part_it_is(film: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = film.with_name("o.csv")
    common = ["track", str(film), "--bodies", str(film.with_name("b.toml")), "--out", str(out)]
    part, sheet = ["--from", "6", "--to", "50"], str(out.with_suffix(".png"))
    assert run(*common, *part, "--preview", "3", "--contact-sheet", sheet) == 0
    assert "frame 21, -4.50 ms" in capsys.readouterr().err
    table = pd.read_csv(out)
    np.testing.assert_array_equal(table["frame"], np.arange(6, 51))
    np.testing.assert_allclose(table["time_s"], (np.arange(6, 51) - 30) / 2000.0, atol=1e-9)
    assert np.abs(table["bar_rad"] - smooth_turn(np.arange(45))).max() < np.radians(0.05)
    before = table.copy()
    assert run(*common, *part, "--retrack", "33") == 0
    table = pd.read_csv(out)
    np.testing.assert_array_equal(table["frame"], before["frame"])
    assert table.loc[27, "bar_rad"] == pytest.approx(before.loc[27, "bar_rad"], abs=1e-4)


@pytest.mark.parametrize("chosen", [("--from", "66"), ("--to", "66"), ("--from", "9", "--to", "8")])
def test_frames_that_are_not_there_are_refused(
    film: Path, chosen: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("track", str(film), "--bodies", str(film.with_name("b.toml")), *chosen) == 2
    assert "the film has 0 to 65; choose others with --from and --to" in capsys.readouterr().err


@pytest.mark.filterwarnings("default::vision.errors.VisionWarning")
def test_frames_that_the_film_lacks_are_rows_of_nan(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    places = np.r_[0:30, 40:70]
    film = write_video(tmp_path / "f.mov", turning_bar(smooth_turn(places, 70)), "png", pixels="rgb24", stamps=places)
    (tmp_path / "b.toml").write_text(OUTLINES)
    out = tmp_path / "o.csv"
    common = ["track", str(film), "--bodies", str(tmp_path / "b.toml"), "--out", str(out), "--frame-rate", "2000"]
    assert run(*common, "--contact-sheet", str(tmp_path / "s.png"), "--figure", str(tmp_path / "f.svg")) == 0
    assert "10 frames missing in 1 gap, after frame 29" in " ".join(capsys.readouterr().err.split())
    table = pd.read_csv(out)
    np.testing.assert_allclose(table["time_s"], np.arange(70) / 2000.0, atol=1e-7)
    missing = table["frame"] == -1
    np.testing.assert_array_equal(np.flatnonzero(missing), np.arange(30, 40))
    np.testing.assert_array_equal(table.loc[~missing, "frame"], np.arange(60))
    assert table.loc[missing].drop(columns=["time_s", "frame", "bar_flag"]).isna().all(axis=None)
    assert (table.loc[missing, "bar_flag"] == 16384).all() and not table.loc[~missing, "bar_rad"].isna().any()
    assert np.abs(table["bar_rad"] - smooth_turn(np.arange(70), 70)).max() < np.radians(0.05)
    assert run(*common[:-2], "--retrack", "31") == 0
    again = pd.read_csv(out)
    assert again.loc[41, "bar_rad"] == pytest.approx(table.loc[41, "bar_rad"], abs=1e-4)
    pd.testing.assert_frame_equal(again.drop(index=41), table.drop(index=41))
    assert run(*common[:-2], "--retrack", "-1") == 2
