"""Films of the stress benchmark, drawn by a renderer that shares no code with `vision`: what is said of each error."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from types import ModuleType

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from vision.bodies.outlines import Body
from vision.errors import VisionWarning
from vision.film.source import ArrayFilm
from vision.results.flags import FrameFlag
from vision.results.track_result import TrackResult
from vision.tracking.track_film import track_film

Tracked = Callable[..., tuple[TrackResult, np.ndarray, np.ndarray]]


@pytest.mark.parametrize(
    ("kind", "surface", "seeds"),
    [
        ("saturation", "speckle", (101,)),
        # python -m pytest -m slow tests/vision/tracking/test_disturbed_films.py
        *(
            pytest.param(*film, (101, 102, 103), marks=pytest.mark.slow)
            for film in (
                ("dust", "wood"),
                ("correlated_noise", "speckle"),
                ("saturation", "speckle"),
                ("correlated_noise", "wood"),
                ("scale_change", "fine"),
                ("neighbour", "fine"),
            )
        ),
    ],
)
def test_coherent_residuals_widen_the_uncertainty(
    tracked: Tracked, kind: str, surface: str, seeds: tuple[int, ...]
) -> None:
    z = np.concatenate([tracked(kind, surface, seed)[2] for seed in seeds])
    assert np.all(np.isfinite(z))
    assert np.abs(z).max() < 5.0
    assert np.sqrt(np.mean(z**2)) < 1.5


@pytest.mark.parametrize(
    ("kind", "surface"),
    [
        ("tilt", "speckle"),
        pytest.param("interlaced_flicker", "fine", marks=pytest.mark.slow),
        pytest.param("shadow_edge", "wood", marks=pytest.mark.slow),
        pytest.param("highlight", "wood", marks=pytest.mark.slow),
        pytest.param("shadow_edge", "speckle", marks=pytest.mark.slow),
        pytest.param("defocus", "speckle", marks=pytest.mark.slow),
    ],
)
def test_what_can_be_told_from_the_pose_is_taken_out(
    stress: ModuleType, tracked: Tracked, kind: str, surface: str
) -> None:
    """Light, tilt and flicker that the fit follows cost little of the uncertainty, and no row a flag."""
    result, _, z = tracked(kind, surface, 131)
    flag = result.flag[stress.STILL :, 0] & ~np.uint16(int(FrameFlag.WIDENED))
    assert not result.failed.any() and np.count_nonzero(flag) <= 2
    assert np.abs(z).max() < 5.0
    assert result.n_still >= stress.STILL - 2
    assert np.median(result.u_angle_rad[stress.STILL :]) < 2.0 * result.predicted_u_rad[0]


def test_rows_widened_but_usable_are_told_from_imprecise_ones(stress: ModuleType) -> None:
    """Smooth noise that begins in the film is in u; a flag says which rows are worse than the others, and how much."""
    film, first = stress.stress_film("clean", "fine", 132), 37
    rng, frames = np.random.default_rng(3), film.frames.astype(float)
    for i in range(first, len(frames)):
        smooth = gaussian_filter(rng.normal(size=frames[i].shape), 2.0)
        frames[i] += 2.35 * smooth / smooth.std()
    frames = np.clip(np.rint(frames), 0, 255).astype(np.uint8)
    result = track_film(ArrayFilm(frames, 2000.0), [Body("bar", film.outline_px)], n_still=stress.STILL)
    error = result.angle_rad[:, 0] - film.angle_rad + film.angle_rad[: stress.STILL].mean()
    assert np.abs(error / result.u_angle_rad[:, 0])[stress.STILL :].max() < 5.0
    u_mdeg, worse = np.degrees(result.u_angle_rad[:, 0]) * 1e3, np.arange(len(frames)) >= first
    widened, imprecise = (np.uint16(int(bit)) for bit in (FrameFlag.WIDENED, FrameFlag.IMPRECISE))
    np.testing.assert_array_equal((result.flag[:, 0] & widened) != 0, worse & (u_mdeg <= 25.0))
    np.testing.assert_array_equal((result.flag[:, 0] & imprecise) != 0, worse & (u_mdeg > 25.0))
    assert np.any(result.flag & widened) and np.any(result.flag & imprecise)


@pytest.mark.slow
def test_noise_of_all_rows_is_in_u_and_coarse_steps_of_grey_have_a_flag(tracked: Tracked) -> None:
    """Steps over felt cannot be seen in the residuals, so that u is not believed."""
    smooth, _, z = tracked("correlated_noise", "fine", 132)
    assert np.abs(z).max() < 5.0 and not smooth.flag.any()
    assert smooth.u_angle_rad[:, 0].min() > 5.0 * smooth.predicted_u_rad[0]
    coarse, _, _ = tracked("quantisation", "fine", 133)
    assert not np.any(coarse.flag & np.uint16(int(FrameFlag.WIDENED)))
    assert np.any(coarse.flag & np.uint16(int(FrameFlag.IMPRECISE)))


@pytest.mark.parametrize(
    "surface", ["speckle", *(pytest.param(name, marks=pytest.mark.slow) for name in ("wood", "fine"))]
)
def test_a_clean_film_keeps_its_uncertainty(stress: ModuleType, tracked: Tracked, surface: str) -> None:
    result, _, z = tracked("clean", surface, 104)
    assert not result.failed.any()
    assert 0.6 < np.sqrt(np.mean(z**2)) < 1.5
    # as predicted before the film was tracked, so nothing was widened
    assert np.median(result.u_angle_rad) == pytest.approx(result.predicted_u_rad[0], rel=0.08)


def test_repeated_frames_are_lost_with_their_flag(stress: ModuleType) -> None:
    film = stress.stress_film("duplicates", "speckle", 105)
    again = np.flatnonzero((film.frames[1:] == film.frames[:-1]).all(axis=(1, 2))) + 1
    assert again.size == 5
    with pytest.warns(VisionWarning, match="5 frames repeat"):
        result = track_film(ArrayFilm(film.frames, 2000.0), [Body("bar", film.outline_px)], n_still=stress.STILL)
    np.testing.assert_array_equal(np.flatnonzero(result.flag[:, 0] == int(FrameFlag.REPEATED)), again)
    np.testing.assert_array_equal(np.flatnonzero(result.failed[:, 0]), again)


@pytest.mark.parametrize(
    ("kind", "surface"),
    [
        pytest.param("vibration", "wood", marks=pytest.mark.slow),
        ("row_flicker", "fine"),
        ("low_light", "speckle"),
        pytest.param("flicker", "wood", marks=pytest.mark.slow),
    ],
)
def test_nothing_is_lost_where_the_bound_permits_tracking(
    stress: ModuleType, tracked: Tracked, kind: str, surface: str
) -> None:
    result, error, z = tracked(kind, surface, 106)
    assert not result.failed.any()
    assert np.abs(z).max() < 5.0 and np.isfinite(error).all()


def test_the_same_film_gives_the_same_bits(stress: ModuleType, tracked: Tracked) -> None:
    film = stress.stress_film("neighbour", "speckle", 501)
    first = tracked("neighbour", "speckle", 501)[0]
    junk = np.empty(10007)  # moves what is allocated next
    with warnings.catch_warnings(action="ignore", category=VisionWarning):
        second = track_film(ArrayFilm(film.frames.copy(), 2000.0), [Body("bar", film.outline_px)])
    del junk
    for name in ("angle_rad", "u_angle_rad", "zncc", "flag"):
        np.testing.assert_array_equal(getattr(second, name), getattr(first, name))
