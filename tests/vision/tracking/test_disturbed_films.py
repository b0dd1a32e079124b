"""Films that something disturbs: what is said of each error."""

from __future__ import annotations

import numpy as np
import pytest

from tests.vision.disturbances import STILL, disturbed, smooth_noise, tracked
from tests.vision.known_films import error_of, quietly_tracked, same_bits
from vision import ArrayFilm, FrameFlag, VisionWarning, track

WIDENED, IMPRECISE = (np.uint16(int(bit)) for bit in (FrameFlag.WIDENED, FrameFlag.IMPRECISE))


KINDS = [
    "clean",
    "saturation",
    "dust",
    "scale_change",
    "correlated_noise",
    "jpeg",
    "defocus",
    "row_flicker",
    "low_light",
]


@pytest.mark.parametrize(
    ("kind", "texture"),
    [
        *((kind, "speckle") for kind in KINDS),
        *((kind, "wood") for kind in ("scale_change", "jpeg", "row_flicker", "low_light")),
    ],
)
def test_the_error_is_in_the_uncertainty_and_a_disturbance_is_taken_for_nothing_else(kind: str, texture: str) -> None:
    """Nothing is lost where the bound permits tracking; the body is rigid, the sensor has no pattern."""
    result, z = tracked(kind, texture)
    assert not result.is_lost.any() and np.abs(z).max() < 5.0 and np.sqrt(np.mean(z**2)) < 1.6
    assert result.info["moving_parts"] == {} and result.info["pattern_grey"] == 0.0


@pytest.mark.parametrize(
    ("kind", "texture"),
    [("tilt", "speckle"), ("shadow_edge", "wood"), ("defocus", "speckle"), ("row_flicker", "speckle")],
)
def test_what_can_be_told_from_the_pose_is_taken_out(kind: str, texture: str) -> None:
    """Light, tilt and flicker that the fit follows cost little of the uncertainty, and no row a flag."""
    result, z = tracked(kind, texture)
    assert not result.is_lost.any() and not np.any(result.flag[STILL:] & ~WIDENED)
    assert np.abs(z).max() < 5.0
    assert result.n_still >= STILL - 2
    assert np.median(result.u_angle_rad[STILL:]) < 2.0 * result.predicted_u_rad[0]


def test_rows_widened_but_usable_are_told_from_imprecise_ones() -> None:
    """Smooth noise that begins in the film is in u; a flag says which rows are worse than the others, and how much."""
    known = disturbed("clean", "speckle")
    rms = np.interp(np.arange(known.film.n_frames), [36, 37, 59], [0.0, 1.0, 12.0])
    film = ArrayFilm(smooth_noise(known.frames, rms), 2000.0)
    result = track(film, known.bodies, n_still=STILL)
    assert np.abs(error_of(result, known.pose) / result.u_angle_rad[:, 0])[STILL:].max() < 5.0
    u_mdeg = np.degrees(result.u_angle_rad[:, 0]) * 1e3
    np.testing.assert_array_equal((result.flag[:, 0] & WIDENED) != 0, (u_mdeg > 12.5) & (u_mdeg <= 25.0))
    np.testing.assert_array_equal((result.flag[:, 0] & IMPRECISE) != 0, u_mdeg > 25.0)
    assert np.any(result.flag & WIDENED) and np.any(result.flag & IMPRECISE)


def test_noise_of_all_rows_is_in_u_and_coarse_steps_of_grey_have_a_flag() -> None:
    """Steps over a weak texture cannot be seen in the residuals, so that u is not believed."""
    smooth, z = tracked("correlated_noise", "wood")
    assert np.abs(z).max() < 5.0 and not smooth.flag.any()
    assert np.median(smooth.u_angle_rad) > 4.0 * smooth.predicted_u_rad[0]
    coarse, _ = tracked("quantisation", "wood")
    assert not np.any(coarse.flag & WIDENED) and np.any(coarse.flag & IMPRECISE)


def test_repeated_frames_are_lost_with_their_flag() -> None:
    known = disturbed("duplicates", "speckle")
    with pytest.warns(VisionWarning, match="5 frames repeat"):
        result = track(known.film, known.bodies, n_still=STILL)
    for lost in (result.flag[:, 0] == int(FrameFlag.REPEATED), result.is_lost[:, 0]):
        np.testing.assert_array_equal(np.flatnonzero(lost), [20, 27, 33, 34, 48])


def test_the_same_film_gives_the_same_bits() -> None:
    known, first = disturbed("dust", "speckle"), tracked("dust", "speckle")[0]
    junk = np.empty(10007)  # moves what is allocated next
    second = quietly_tracked(ArrayFilm(known.frames, 2000.0), known.bodies)
    del junk
    same_bits(second, first)
