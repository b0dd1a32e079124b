"""What a film cannot be is said: on films of the stress benchmark's renderer, which shares no code with `vision`.

No row of them is off by more than five of its total uncertainty without a flag or a line that names the cause, while
clean films have neither.
"""

from __future__ import annotations

import warnings
from dataclasses import replace
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from vision.bodies.outlines import Body
from vision.camera.model import CalibratedCamera
from vision.errors import VisionInputError, VisionWarning
from vision.film.source import ArrayFilm, Compression
from vision.results.flags import FrameFlag
from vision.results.track_result import TrackResult
from vision.tracking.retrack import retrack_frames
from vision.tracking.track_film import track as track_film

STILL = 14


class Tracked:
    """A stress film as it was tracked: result, errors of the moving rows (rad), lines."""

    def __init__(self, film: Any, rate_hz: float = 2000.0, **options: Any) -> None:
        source = ArrayFilm(film.frames, rate_hz)
        for name, value in film.facts.items():
            setattr(source, name, value)
        with warnings.catch_warnings(record=True, action="always", category=VisionWarning) as caught:
            self.result: TrackResult = track_film(source, [Body("bar", film.outline_px)], **{**film.options, **options})
        self.lines = [str(one.message) for one in caught]
        error = self.result.angle_rad[:, 0] - film.angle_rad + film.angle_rad[: min(self.result.n_still, STILL)].mean()
        self.error = error[STILL:]
        self.z = self.error / self.result.u_total_rad[STILL:, 0]
        self.z_noise = self.error / self.result.u_angle_rad[STILL:, 0]
        self.flag = self.result.flag[STILL:, 0]

    def says(self, words: str) -> bool:
        return any(words in line for line in self.lines)


@pytest.fixture(scope="module")
def draw(stress: ModuleType) -> Any:
    return stress.stress_film


@pytest.mark.parametrize(("surface", "rate_hz"), [("speckle", 500.0), ("fine", 10_000.0)])
def test_clean_films_have_no_line_no_flag_and_their_uncertainty(draw: Any, surface: str, rate_hz: float) -> None:
    films = [Tracked(draw("clean", surface, seed), rate_hz) for seed in (41, 42, 43)]
    assert not any(film.lines for film in films)
    assert np.mean(np.concatenate([film.flag for film in films]) != 0) <= 0.01
    assert 0.8 < np.sqrt(np.mean(np.concatenate([film.z_noise for film in films]) ** 2)) < 1.2
    assert all(film.result.info["delay_frames"] == 0.0 for film in films)


@pytest.mark.parametrize(
    ("kind", "surface", "rate_hz"),
    [("recursive_filter", "speckle", 500.0), ("frame_blend", "wood", 2000.0), ("recursive_filter", "fine", 10_000.0)],
)
def test_motion_filtered_in_time_is_flagged_with_its_lag(draw: Any, kind: str, surface: str, rate_hz: float) -> None:
    film = draw(kind, surface, 41)
    tracked = Tracked(film, rate_hz)
    assert tracked.says("correlated in time")
    assert np.abs(tracked.z).max() < 5.0
    far = np.abs(tracked.error) > 5.0 * tracked.result.u_angle_rad[STILL:, 0]
    assert far.any()
    assert np.all(tracked.flag[far] & int(FrameFlag.TIME_FILTERED))
    # the term is a time, so the same film at any rate has the same angles of it
    lag = tracked.result.budget.absolute["lag"]
    assert np.nanmax(lag) == pytest.approx(
        tracked.result.info["delay_frames"] * np.abs(np.diff(film.angle_rad)).max(), rel=0.25
    )


@pytest.mark.parametrize("stated", ["facts", "options"])
@pytest.mark.parametrize("stretch", [8.0 / 9.0, 1.25])
def test_a_pixel_aspect_that_is_known_is_used(stress: ModuleType, stated: str, stretch: float) -> None:
    film = _stretched(stress, stretch)
    getattr(film, stated)["pixel_aspect"] = 1.0 / stretch
    tracked = Tracked(film)
    assert not tracked.lines
    assert np.abs(tracked.z).max() < 5.0
    assert 0.7 < np.sqrt(np.mean(tracked.z_noise**2)) < 1.3
    # places are pixels of the film, which a single frame can be fitted from again
    result = tracked.result
    row = 40
    near = {"bar": (result.angle_rad[row, 0], result.x_px[row, 0], result.y_px[row, 0])}
    source = ArrayFilm(film.frames, 2000.0)
    source.pixel_aspect = 1.0 / stretch
    again = retrack_frames(source, [Body("bar", film.outline_px)], [row], [near])
    np.testing.assert_allclose(again.x_px[0], result.x_px[row], atol=0.02)
    np.testing.assert_allclose(again.angle_rad[0], result.angle_rad[row], atol=1e-4)


@pytest.mark.parametrize("stretch", [1.02, 0.99, 1.125])
def test_a_pixel_aspect_that_nobody_states_is_measured_by_the_body_that_turns(
    stress: ModuleType, stretch: float
) -> None:
    tracked = Tracked(_stretched(stress, stretch))
    assert tracked.says("width over height")
    said = next(line for line in tracked.lines if "width over height" in line)
    value = float(said.split("width over height ")[1].split(" ")[0])
    assert value == pytest.approx(1.0 / stretch, abs=0.15 * abs(stretch - 1.0))
    assert abs(stretch - 1.0) < 0.1 or np.abs(tracked.z_noise).max() > 5.0
    assert np.abs(tracked.z).max() < 5.0


def _stretched(stress: ModuleType, stretch: float) -> Any:
    """A film whose picture is stretched along x, nothing said of it; drawn anew, as its facts are changed."""

    def kind(shot: Any) -> None:
        shot.stretch = stretch

    stress.KINDS["stretched"], stress.NUMBER["stretched"] = kind, 200
    try:
        return stress.stress_film.__wrapped__("stretched", "speckle", 41)
    finally:
        del stress.KINDS["stretched"], stress.NUMBER["stretched"]


@pytest.mark.parametrize("stretch", [1.034, 1.12])
def test_a_calibrated_stretch_leaves_nothing(stress: ModuleType, stretch: float) -> None:
    film = _stretched(stress, stretch)
    a = (stretch - 1.0) / (stretch + 1.0)
    height, width = film.frames.shape[1:]
    camera = CalibratedCamera(width, height, np.array([a, 0, 0, 0, 0]), np.zeros((5, 5)), 1e4, 1.0)
    tracked = Tracked(film, camera=camera)
    assert not tracked.lines
    assert np.all(tracked.flag == 0)
    assert np.abs(tracked.z).max() < 5.0
    assert 0.6 < np.sqrt(np.mean(tracked.z**2)) < 1.4
    with pytest.raises(VisionInputError, match="pixel_aspect"):
        Tracked(film, camera=camera, pixel_aspect=1.1)


def test_interlaced_frames_are_refused_or_one_field_is_tracked(draw: Any) -> None:
    film = draw("interlaced", "speckle", 41)
    with pytest.raises(VisionInputError, match=r"interlaced.*--deinterlace"):
        Tracked(film, deinterlace=False)
    tracked = Tracked(film)
    assert np.isfinite(tracked.error).all() and np.abs(tracked.z).max() < 5.0
    # u is not much more than the error: motion shows when the rows were exposed
    assert 0.5 < np.sqrt(np.mean(tracked.z**2)) < 1.2
    assert np.ptp(tracked.result.budget.absolute["interlace"][:, 0]) == 0.0 and not tracked.lines


@pytest.mark.parametrize(("kind", "surface", "seed"), [("row_flicker", "fine", 9203), ("ghost", "speckle", 9202)])
def test_flicker_of_rows_is_no_filter_and_a_weak_reflection_no_stretch(
    draw: Any, kind: str, surface: str, seed: int
) -> None:
    """A lamp's light between rows is correlated in time; a reflection at rest bends a body by a thousandth."""
    tracked = Tracked(draw(kind, surface, seed))
    assert not tracked.lines and np.abs(tracked.z).max() < 5.0


def upside_down(film: Any, **facts: Any) -> Any:
    """The film mirrored top to bottom, which swaps even and odd rows and turns angles round."""
    frames = film.frames[:, ::-1]
    outline = np.column_stack([film.outline_px[:, 0], frames.shape[1] - 1 - film.outline_px[:, 1]])
    return replace(film, frames=frames, angle_rad=-film.angle_rad, outline_px=outline, facts={**film.facts, **facts})


@pytest.mark.parametrize("surface", ["speckle", "wood", "fine"])
@pytest.mark.parametrize("stated", [None, "even", "odd"])
def test_the_field_exposed_first_is_tracked_whatever_the_file_says(draw: Any, surface: str, stated: str | None) -> None:
    for first, film in (
        ("even", draw("interlaced", surface, 61)),
        ("odd", upside_down(draw("interlaced", surface, 61))),
    ):
        tracked = Tracked(replace(film, facts={**film.facts, "first_field": stated}))
        assert tracked.result.info["first_field"] == first
        assert tracked.says(f"its file says {stated} rows first, {first} ones") == (stated not in (None, first))
        assert np.abs(tracked.z).max() < 5.0 and np.sqrt(np.mean(tracked.z**2)) > 0.4


@pytest.mark.parametrize("surface", ["speckle", "fine"])
def test_interlaced_frames_of_which_the_file_says_nothing_are_named(draw: Any, surface: str) -> None:
    woven = draw("interlaced", surface, 62)
    for film, later in ((woven, "odd"), (upside_down(woven), "even")):
        tracked = Tracked(replace(film, facts={}, options={}))
        assert tracked.says(f"interlaced: {later} rows were exposed 0.") and tracked.says("--deinterlace")
        assert np.abs(tracked.z).max() < 5.0
        fast = np.abs(np.gradient(film.angle_rad))[STILL:] > 1e-3
        assert fast.any() and np.all(tracked.flag[fast] & int(FrameFlag.TIME_FILTERED))


def test_frames_called_interlaced_whose_rows_are_of_one_time_are_tracked_whole(draw: Any) -> None:
    film = draw("clean", "speckle", 43)
    tracked = Tracked(replace(film, facts={"is_interlaced": True}), deinterlace=True)
    assert tracked.says("of one time") and tracked.says("whole frames are tracked")
    np.testing.assert_array_equal(tracked.result.angle_rad, Tracked(film).result.angle_rad)
    given = Tracked(replace(film, facts={"is_interlaced": True}), deinterlace=True, first_field="odd")
    assert given.says("odd rows are given as first") and given.result.info["first_field"] == "odd"
    with pytest.raises(VisionInputError, match="first_field"):
        Tracked(film, first_field="left")


@pytest.mark.parametrize(("gain", "word"), [(0.03, "dark"), (3.0, "flashed")])
@pytest.mark.parametrize("first", [1, 3])
def test_first_frames_of_another_light_are_named(draw: Any, gain: float, word: str, first: int) -> None:
    frames = draw("clean", "wood", 41).frames.copy()
    frames[:first] = np.clip(gain * frames[:first].astype(float), 0, 255).astype(np.uint8)
    film = ArrayFilm(frames, 2000.0)
    with pytest.raises(VisionInputError, match=f"{word}.*--from {first}"):
        track_film(film, [Body("bar", draw("clean", "wood", 41).outline_px)])


def test_a_body_that_turns_in_frames_given_as_still_is_named(draw: Any) -> None:
    film = draw("clean", "speckle", 42)
    assert not Tracked(film, n_still=STILL).lines
    tracked = Tracked(film, n_still=30)
    assert tracked.says("body bar moves from about frame 1")
    assert tracked.says("--n-still 1")


def test_frames_repeated_before_a_predicting_codec_are_lost_as_repeated(draw: Any) -> None:
    pytest.importorskip("av")
    film = draw("h264_duplicates", "fine", 11)
    tracked = Tracked(film)
    repeated = np.flatnonzero(tracked.result.flag[:, 0] & int(FrameFlag.REPEATED))
    step = np.abs(np.diff(film.angle_rad))
    planted = np.arange(STILL + 1, 60, 5)
    # as it was drawn: a frame is repeated while the body moves on
    moving = [frame for frame in planted if step[frame - 1] > np.radians(0.15)]
    assert set(moving) <= set(repeated.tolist()) <= set(planted.tolist())
    assert tracked.says("repeat the one before")
    clean = Tracked(draw("h264_stated", "fine", 11))
    assert not np.any(clean.result.flag & int(FrameFlag.REPEATED))


def test_repeats_are_not_looked_for_where_frames_are_stored_whole(draw: Any) -> None:
    film = draw("clean", "fine", 41)
    source = ArrayFilm(film.frames, 2000.0)
    source.compression = Compression(np.ones((8, 8)))
    result = track_film(source, [Body("bar", film.outline_px)])
    assert not np.any(result.flag & int(FrameFlag.REPEATED))
