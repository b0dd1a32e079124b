"""What a film cannot be is said: of a turning bar whose film is filtered, stretched, interlaced, dark or repeated.

No row is off by more than five of its total uncertainty without a line that names the cause; clean films have none.
Many more films, drawn without `vision.synthetic`: ``python -m benchmarks tracking_stress``.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import ndimage

from tests.vision.known_films import HEIGHT, PIVOT, WIDTH, Cover, bar_scene, film_of, smooth_step
from tests.vision.turning_bar import write_video
from vision import (
    ArrayFilm,
    Body,
    CalibratedCamera,
    FrameFlag,
    VisionInputError,
    VisionWarning,
    open_film,
    retrack_frames,
    track,
)
from vision.film.source import Compression

N, STILL = 60, 14
Y, X = np.mgrid[0:HEIGHT, 0:WIDTH].astype(float)
Frames = NDArray[np.uint8]


@dataclass(frozen=True)
class Drawn:
    """A film, what its file states, how it is tracked, and its truth."""

    frames: Frames
    angle_rad: NDArray[np.float64]
    outline_px: NDArray[np.float64]
    facts: dict[str, Any] = field(default_factory=dict)
    options: dict[str, Any] = field(default_factory=dict)

    def source(self) -> ArrayFilm:
        return _stating(ArrayFilm(self.frames, 2000.0), self.facts)


def _stating(film: Any, facts: dict[str, Any]) -> Any:
    for name, value in facts.items():
        setattr(film, name, value)
    return film


def _stretched(stretch: float) -> Cover:
    """The picture wider by a factor around its middle."""

    def cover(_: int, light: NDArray[np.float32]) -> None:
        x = WIDTH / 2 + (X - WIDTH / 2) / stretch
        light[:] = ndimage.map_coordinates(light, [Y, x], order=3, mode="nearest")

    return cover


@cache
def draw(texture: str, seed: int, *, stretch: float = 1.0, is_woven: bool = False, cover: Cover | None = None) -> Drawn:
    """A bar that turns by 7 to 17 degrees and drifts; odd rows half a frame later where the film is woven."""
    rng = np.random.default_rng(seed)
    turn = rng.choice([-1, 1]) * rng.uniform(0.12, 0.3)
    s = smooth_step((np.arange(0.0, N, 0.5 if is_woven else 1.0) - STILL - 1) / (N - STILL - 6))
    pose = np.column_stack([turn * s, PIVOT[0] + 6.0 * s, PIVOT[1] + 3.0 * s])[:, None]
    change = _stretched(stretch) if stretch != 1.0 else cover
    known = film_of(bar_scene(texture, seed), pose, seed=seed, cover=change)
    frames, outline = known.frames, np.array(known.bodies[0].polygon_px, dtype=float)
    outline[:, 0] = WIDTH / 2 + stretch * (outline[:, 0] - WIDTH / 2)
    if is_woven:
        frames[::2, 1::2] = frames[1::2, 1::2]
        return Drawn(frames[::2], pose[::2, 0, 0], outline, {"is_interlaced": True}, {"deinterlace": True})
    return Drawn(frames, pose[:, 0, 0], outline)


class Tracked:
    """A film as it was tracked: result, errors of the moving rows (rad), lines."""

    def __init__(self, drawn: Drawn, film: Any = None, **options: Any) -> None:
        film = drawn.source() if film is None else film
        with warnings.catch_warnings(record=True, action="always", category=VisionWarning) as caught:
            self.result = track(film, [Body("bar", drawn.outline_px)], **{**drawn.options, **options})
        self.lines = [str(one.message) for one in caught]
        true = drawn.angle_rad - drawn.angle_rad[: min(self.result.n_still, STILL)].mean()
        self.error = (self.result.angle_rad[:, 0] - true)[STILL:]
        self.z = self.error / self.result.u_total_rad[STILL:, 0]
        self.z_noise = self.error / self.result.u_angle_rad[STILL:, 0]
        self.flag = self.result.flag[STILL:, 0]

    def says(self, words: str) -> bool:
        return any(words in line for line in self.lines)


@pytest.mark.parametrize("rate_hz", [500.0, 10_000.0])
def test_clean_films_have_no_line_no_flag_and_their_uncertainty(rate_hz: float) -> None:
    drawn = draw("speckle", 41)
    tracked = Tracked(drawn, ArrayFilm(drawn.frames, rate_hz))
    assert not tracked.lines and np.mean(tracked.flag != 0) <= 0.02
    assert 0.7 < np.sqrt(np.mean(tracked.z_noise**2)) < 1.4
    assert tracked.result.info["delay_frames"] == 0.0


def _recursive(frames: Frames) -> Frames:
    """Each keeps half of the one before, as a camera's noise reduction does."""
    out = frames.astype(float)
    for k in range(1, len(out)):
        out[k] += 0.5 * (out[k - 1] - out[k])
    return np.rint(out).astype(np.uint8)


def _blended(frames: Frames) -> Frames:
    """Each is a mixture with the one before, as after a change of the frame rate."""
    out = frames.astype(float)
    out[1:] = 0.4 * frames[:-1] + 0.6 * frames[1:]
    return np.rint(out).astype(np.uint8)


@pytest.mark.parametrize(
    ("averaged", "texture", "rate_hz"), [(_recursive, "speckle", 500.0), (_blended, "wood", 10_000.0)]
)
def test_motion_filtered_in_time_is_flagged_with_its_lag(
    averaged: Callable[[Frames], Frames], texture: str, rate_hz: float
) -> None:
    drawn = draw(texture, 41)
    tracked = Tracked(drawn, ArrayFilm(averaged(drawn.frames), rate_hz))
    assert tracked.says("correlated in time")
    assert np.abs(tracked.z).max() < 5.0
    far = np.abs(tracked.z_noise) > 5.0
    assert far.any()
    assert np.all(tracked.flag[far] & int(FrameFlag.TIME_FILTERED))
    # the term is a time, so the same film at any rate has the same angles of it
    lag = tracked.result.budget.absolute["lag"]
    assert np.nanmax(lag) == pytest.approx(
        tracked.result.info["delay_frames"] * np.abs(np.diff(drawn.angle_rad)).max(), rel=0.25
    )


@pytest.mark.parametrize(("stated", "stretch"), [("facts", 8.0 / 9.0), ("options", 1.25)])
def test_a_pixel_aspect_that_is_known_is_used(stated: str, stretch: float) -> None:
    drawn = replace(draw("speckle", 41, stretch=stretch), **{stated: {"pixel_aspect": 1.0 / stretch}})
    tracked = Tracked(drawn)
    assert not tracked.lines
    assert np.abs(tracked.z).max() < 5.0
    assert 0.7 < np.sqrt(np.mean(tracked.z_noise**2)) < 1.3
    # places are pixels of the film, which a single frame can be fitted from again
    result, row = tracked.result, 40
    near = {"bar": (result.angle_rad[row, 0], result.x_px[row, 0], result.y_px[row, 0])}
    source = _stating(drawn.source(), {"pixel_aspect": 1.0 / stretch})
    again = retrack_frames(source, [Body("bar", drawn.outline_px)], [row], [near])
    np.testing.assert_allclose(again.x_px[0], result.x_px[row], atol=0.02)
    np.testing.assert_allclose(again.angle_rad[0], result.angle_rad[row], atol=1e-4)


@pytest.mark.parametrize(("texture", "stretch"), [("speckle", 0.99), ("wood", 1.125)])
def test_a_pixel_aspect_that_nobody_states_is_measured_by_the_body_that_turns(texture: str, stretch: float) -> None:
    tracked = Tracked(draw(texture, 41, stretch=stretch))
    (said,) = [line for line in tracked.lines if "width over height" in line]
    aspect, seen, u = (
        float(re.split("[ ,)]", said.split(before)[1])[0])
        for before in ("width over height ", "along x against y by ", "(u ")
    )
    assert seen == pytest.approx(stretch, abs=3.0 * u) and u < 0.003
    assert seen == pytest.approx(1.0 / aspect, abs=2e-4)
    # what is seen, and all that shows the same
    assert "a lens or a tilted camera" in said and "a body that bends" in said
    assert abs(stretch - 1.0) < 0.1 or np.abs(tracked.z_noise).max() > 5.0
    assert np.abs(tracked.z).max() < 5.0


def test_a_calibrated_stretch_leaves_nothing() -> None:
    stretch = 1.12
    drawn = draw("speckle", 41, stretch=stretch)
    a = (stretch - 1.0) / (stretch + 1.0)
    camera = CalibratedCamera(WIDTH, HEIGHT, np.array([a, 0, 0, 0, 0]), np.zeros((5, 5)), 1e4, 1.0)
    tracked = Tracked(drawn, camera=camera)
    assert not tracked.lines
    assert np.all(tracked.flag == 0)
    assert np.abs(tracked.z).max() < 5.0
    assert 0.6 < np.sqrt(np.mean(tracked.z**2)) < 1.4
    with pytest.raises(VisionInputError, match="pixel_aspect"):
        Tracked(drawn, camera=camera, pixel_aspect=1.1)


def _flickering(i: int, light: NDArray[np.float32]) -> None:
    """A lamp's light between rows, which is correlated in time."""
    light *= (1.0 + 0.1 * np.cos(2.0 * np.pi * Y / 250.0 + 1.3 * i)).astype(np.float32)


def _reflecting(_: int, light: NDArray[np.float32]) -> None:
    """A reflection of the room at rest, which bends a body by a thousandth."""
    room = ndimage.gaussian_filter(np.random.default_rng(2).normal(size=light.shape), 2.5)
    light += (2.0 * room / room.std()).astype(np.float32)


@pytest.mark.parametrize("cover", [_flickering, _reflecting])
def test_flicker_of_rows_is_no_filter_and_a_weak_reflection_no_stretch(cover: Cover) -> None:
    tracked = Tracked(draw("speckle", 43, cover=cover))
    assert not tracked.lines and np.abs(tracked.z).max() < 5.0


def _upside_down(film: Drawn) -> Drawn:
    """The film mirrored top to bottom, which swaps even and odd rows and turns angles round."""
    outline = np.column_stack([film.outline_px[:, 0], HEIGHT - 1 - film.outline_px[:, 1]])
    return replace(film, frames=film.frames[:, ::-1], angle_rad=-film.angle_rad, outline_px=outline)


WOVEN = {
    "even": lambda: draw("speckle", 61, is_woven=True),
    "odd": lambda: _upside_down(draw("speckle", 61, is_woven=True)),
}


@pytest.mark.parametrize(("first", "stated"), [("even", None), ("odd", "even")])
def test_the_field_exposed_first_is_tracked_whatever_the_file_says(first: str, stated: str | None) -> None:
    film = WOVEN[first]()
    tracked = Tracked(replace(film, facts={**film.facts, "first_field": stated}))
    assert tracked.result.info["first_field"] == first
    assert tracked.says(f"its file says {stated} rows first, {first} ones") == (stated not in (None, first))
    assert np.isfinite(tracked.error).all() and np.abs(tracked.z).max() < 5.0
    # u is not much more than the error: motion shows when the rows were exposed
    assert 0.4 < np.sqrt(np.mean(tracked.z**2)) < 1.3
    assert np.ptp(tracked.result.budget.absolute["interlace"][:, 0]) == 0.0


def test_interlaced_frames_are_refused_where_no_field_is_asked_for() -> None:
    with pytest.raises(VisionInputError, match=r"interlaced.*`deinterlace`"):
        Tracked(WOVEN["even"](), deinterlace=False)


@pytest.mark.parametrize(("first", "later"), [("even", "odd")])
def test_interlaced_frames_of_which_the_file_says_nothing_are_named(first: str, later: str) -> None:
    film = replace(WOVEN[first](), facts={}, options={})
    tracked = Tracked(film)
    assert tracked.says(f"interlaced: {later} rows were exposed 0.") and tracked.says("`deinterlace`")
    assert np.abs(tracked.z).max() < 5.0
    fast = np.abs(np.gradient(film.angle_rad))[STILL:] > 1e-3
    assert fast.any() and np.all(tracked.flag[fast] & int(FrameFlag.TIME_FILTERED))


def test_frames_called_interlaced_whose_rows_are_of_one_time_are_tracked_whole() -> None:
    whole = draw("speckle", 43)
    film = replace(whole, facts={"is_interlaced": True})
    tracked = Tracked(film, deinterlace=True)
    assert tracked.says("of one time") and tracked.says("whole frames are tracked")
    np.testing.assert_array_equal(tracked.result.angle_rad, Tracked(whole).result.angle_rad)
    given = Tracked(film, deinterlace=True, first_field="odd")
    assert given.says("odd rows are given as first") and given.result.info["first_field"] == "odd"
    with pytest.raises(VisionInputError, match="first_field"):
        Tracked(whole, first_field="left")


@pytest.mark.parametrize(("gain", "word", "first"), [(0.03, "dark", 1), (3.0, "flashed", 3)])
def test_first_frames_of_another_light_are_named(gain: float, word: str, first: int) -> None:
    drawn = draw("wood", 41)
    frames = drawn.frames.copy()
    frames[:first] = np.clip(gain * frames[:first].astype(float), 0, 255).astype(np.uint8)
    with pytest.raises(VisionInputError, match=f"{word}.*`first_frame` {first}"):
        track(ArrayFilm(frames, 2000.0), [Body("bar", drawn.outline_px)])


def test_a_body_that_turns_in_frames_given_as_still_is_named() -> None:
    film = draw("speckle", 43)
    assert not Tracked(film, n_still=STILL).lines
    tracked = Tracked(film, n_still=30)
    assert tracked.says("body bar moves from about frame 1")
    assert tracked.says("`n_still` 1")


def _predicted(tmp_path: Path, frames: Frames) -> Any:
    """The film by a codec that predicts frames from their neighbours."""
    # x264 weighs blocks by what lies beyond the picture, which PyAV leaves as it is: another film each time
    options = {"crf": "18", "threads": "1", "x264-params": "no-mbtree=1"}
    path = write_video(tmp_path / "film.mp4", frames, "libx264", pixels="yuv420p", options=options)
    with pytest.warns(VisionWarning, match="predicts frames"):
        return open_film(path)


def test_frames_repeated_before_a_predicting_codec_are_lost_as_repeated(tmp_path: Path) -> None:
    drawn, frames = draw("speckle", 11), draw("speckle", 11).frames.copy()
    planted = np.arange(STILL + 1, N, 5)
    frames[planted] = frames[planted - 1]
    tracked = Tracked(drawn, _predicted(tmp_path, frames))
    repeated = np.flatnonzero(tracked.result.flag[:, 0] & int(FrameFlag.REPEATED))
    # as it was drawn: a frame is repeated while the body moves on
    moving = planted[np.abs(np.diff(drawn.angle_rad))[planted - 1] > np.radians(0.15)]
    assert set(moving) <= set(repeated) <= set(planted) and len(moving) > 3
    assert tracked.says("repeat the one before")


def test_a_film_without_repeats_has_none_however_its_frames_are_stored(tmp_path: Path) -> None:
    drawn = draw("speckle", 11)
    for film in (
        _predicted(tmp_path, drawn.frames),
        _stating(drawn.source(), {"compression": Compression(np.ones((8, 8)))}),
    ):
        result = Tracked(drawn, film).result
        assert not np.any(result.flag & int(FrameFlag.REPEATED))
