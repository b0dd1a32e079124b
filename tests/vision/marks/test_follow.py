"""Points and lines against known motion: error, uncertainty, direction, and what is refused."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy import ndimage, special

from tests.vision.known_films import PIVOT, bar_scene, dark, film_of, smooth_step
from vision import ArrayFilm, BodyError, LineMark, PointMark, VisionInputError, follow_marks, load_marks

H, W, N, STILL = 120, 160, 110, 16
Y, X = np.mgrid[0:H, 0:W].astype(float)
WALL = 90.0 + 4.0 * ndimage.gaussian_filter(np.random.default_rng(1).normal(size=(H, W)), 6.0) * 20.0


def film(draw: Callable[[int], np.ndarray], seed: int = 0, noise: float = 2.0, flicker: float = 0.1) -> ArrayFilm:
    """Noise, rounding and flicker added to drawn frames."""
    rng, frames = np.random.default_rng(seed), []
    for i in range(N):
        light = draw(i) * (1.0 + flicker * np.cos(0.7 * i))
        frames.append(np.clip(np.rint(light + rng.normal(0.0, noise, light.shape)), 0, 255))
    return ArrayFilm(np.array(frames, dtype=np.uint8), 2000.0)


def edge(distance: np.ndarray, width: float = 1.1) -> np.ndarray:
    """0 to 1 across a blurred edge."""
    return 0.5 + 0.5 * special.erf(distance / (np.sqrt(2.0) * width))


def dot(x: float, y: float, radius: float = 6.0) -> np.ndarray:
    """A dark dot on the wall."""
    inside = edge(radius - np.hypot(X - x, Y - y))
    return WALL * (1.0 - inside) + 30.0 * inside


def test_a_round_dot_is_followed_without_a_turn() -> None:
    s = smooth_step((np.arange(N) - STILL - 2) / 70)
    x, y = 60.3 + 31.0 * s, 55.7 - 18.0 * s
    z = []
    for seed in range(2):
        result = follow_marks(film(lambda i: dot(x[i], y[i]), seed), [PointMark("dot", (60.0, 56.0), 10.0)])
        assert not result.is_lost.any() and np.isnan(result.turn_rad).all()
        moving = slice(STILL, None)
        for found, true, u in ((result.x_px, x, result.u_x_px), (result.y_px, y, result.u_y_px)):
            error = (found[:, 0] - found[:STILL, 0].mean()) - (true - true[:STILL].mean())
            z.append(error[moving] / u[moving, 0])
            assert np.sqrt(np.mean(error**2)) < 0.05
    z = np.array(z)
    assert np.abs(z).max() < 5.0 and 0.6 < np.sqrt(np.mean(z**2)) < 1.5
    table = result.to_table()
    assert list(table.columns) == ["time_s", "frame", "dot_x_px", "dot_y_px", "dot_u_x_px", "dot_u_y_px", "dot_quality",
                                   "dot_inlier", "dot_flag"]  # fmt: skip


@pytest.mark.parametrize(
    ("angle", "texture"),
    [
        (0.0, 0.0),
        (0.6, 1.0),
        (2.2, 1.0),
        (-1.9, 0.0),
        (0.6, 1.0),
    ],
)
def test_an_edge_moves_across_itself(angle: float, texture: float) -> None:
    """Offset to the left of the line, turn counter-clockwise; the texture of a wall behind does not move with it."""
    wall = 90.0 + texture * (WALL - 90.0)
    s = smooth_step((np.arange(N) - STILL - 2) / 70)
    offset, turn = 7.0 * s, 0.08 * s
    cx, cy = 78.0, 61.0
    along = np.array([np.cos(angle), -np.sin(angle)])  # counter-clockwise in the picture, whose y points down
    left = np.array([along[1], -along[0]])

    def draw(i: int) -> np.ndarray:
        c, sn = np.cos(turn[i]), np.sin(turn[i])
        normal = np.array([c * left[0] + sn * left[1], c * left[1] - sn * left[0]])
        middle = np.array([cx, cy]) + offset[i] * left
        inside = edge((X - middle[0]) * normal[0] + (Y - middle[1]) * normal[1])
        return wall * (1.0 - inside) + 160.0 * inside

    mark = LineMark("rim", tuple(np.array([cx, cy]) - 24.0 * along), tuple(np.array([cx, cy]) + 24.0 * along), 14.0)
    result = follow_marks(film(draw, 3), [mark])
    assert not result.is_lost.any() and np.isnan(result.x_px).all()
    middle = slice(STILL, None)
    for found, true, u in ((result.offset_px, offset, result.u_offset_px), (result.turn_rad, turn, result.u_turn_rad)):
        error = found[:, 0] - found[:STILL, 0].mean() - true
        z = error[middle] / u[middle, 0]
        assert np.abs(z).max() < 5.0 and np.sqrt(np.mean(z**2)) < (2.5 if texture else 1.5)
    assert np.median(result.u_offset_px) < 0.1


def test_a_line_at_rest_does_not_slide_along_itself() -> None:
    """Three pixels beyond the drawn band the line ends; noise alone must not carry the band there."""
    height, width, n = 50, 64, 500
    y, x = np.mgrid[0:height, 0:width].astype(float)
    light = 70.0 + 90.0 * edge(y - 25.4 - 0.1 * (x - 32.0) - np.where(np.abs(x - 32.0) < 23.0, 0.0, 4.0))
    noise = np.random.default_rng(3).normal(0.0, 8.0, (n, height, width))
    frames = np.clip(np.rint(light + noise), 0, 255).astype(np.uint8)
    result = follow_marks(ArrayFilm(frames, 2000.0), [LineMark("rim", (12.0, 23.4), (52.0, 27.4), 10.0)])
    assert result.n_still > 32 and not result.is_lost.any()
    z = (result.offset_px[:, 0] - result.offset_px[: result.n_still, 0].mean()) / result.u_offset_px[:, 0]
    assert 0.8 < np.sqrt(np.mean(z**2)) < 1.2
    assert result.inlier[-100:].mean() > result.inlier[:100].mean() - 0.01


def test_a_line_along_the_rows_has_still_frames() -> None:
    rng, light = np.random.default_rng(4), 70.0 + 90.0 * edge(Y[:50, :64] - 25.4)
    frames = np.rint(light + rng.normal(0.0, 2.0, (10, 50, 64))).astype(np.uint8)
    thin = LineMark("string", (12.0, 25.0), (52.0, 25.0), 4.0)
    assert follow_marks(ArrayFilm(frames, 2000.0), [thin]).n_still == 10


def test_the_smallest_mark_in_a_film_without_noise() -> None:
    """Frames at rest are equal there, and are no repeated ones."""
    frames = np.rint([dot(60.0 + 0.5 * max(i - 24, 0), 56.0, 2.5) for i in range(40)]).astype(np.uint8)
    result = follow_marks(ArrayFilm(frames, 2000.0), [PointMark("dot", (60.0, 56.0), 3.0)], n_still=12)
    assert not result.is_lost[:25].any()


def test_textured_spot_gives_its_turn_and_lost_frames_are_flagged() -> None:
    s = smooth_step((np.arange(80) - 16) / 50)
    pose = np.column_stack([0.3 * s, PIVOT[0] + 5.0 * s, PIVOT[1] - 4.0 * s])[:, None, :]
    known = film_of(bar_scene("speckle"), pose, cover=dark(range(40, 44)))
    result = follow_marks(known.film, [PointMark("spot", (PIVOT[0] + 30.0, PIVOT[1]), 14.0)])
    np.testing.assert_array_equal(np.flatnonzero(result.is_lost[:, 0]), np.arange(40, 44))
    good = ~result.is_lost[:, 0]
    error = (result.turn_rad[:, 0] - pose[:, 0, 0])[good] / result.u_turn_rad[good, 0]
    assert np.abs(error).max() < 5.0
    x = pose[:, 0, 1] + 30.0 * np.cos(pose[:, 0, 0])
    z = ((result.x_px[:, 0] - x) - (result.x_px[:16, 0] - x[:16]).mean())[good] / result.u_x_px[good, 0]
    assert np.abs(z).max() < 5.0


def test_what_shows_no_motion_is_refused() -> None:
    still = film(lambda _: dot(60.0, 56.0))
    with pytest.raises(BodyError, match="no spot with contrast in all directions"):
        follow_marks(film(lambda _: 30.0 + 100.0 * edge(Y - 60.0)), [PointMark("p", (80.0, 60.0), 9.0)])
    with pytest.raises(BodyError, match="no edge"):
        follow_marks(film(lambda _: np.full((H, W), 90.0)), [LineMark("l", (30.0, 90.0), (80.0, 90.0), 12.0)])
    with pytest.raises(BodyError, match="usable pixels"):
        follow_marks(still, [PointMark("p", (60.0, 56.0)), PointMark("q", (400.0, 56.0))])
    with pytest.raises(VisionInputError, match="no mark"):
        follow_marks(still, [])
    with pytest.raises(VisionInputError, match=r"every = 1\.5"):
        follow_marks(still, [PointMark("dot", (60.0, 56.0))], every=1.5)
    with pytest.raises(VisionInputError, match="'r' was not followed"):
        follow_marks(still, [PointMark("dot", (60.0, 56.0))], every=20).column("r")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "holds nothing"),
        ("[[disc]]\nname = 'a'", "table 'disc'"),
        ("[[point]]\nname = 'a'", "lacks or does not know 'at_px'"),
        ("[[point]]\nname = 'a'\nat_px = [1, 2]\nsize = 3", "'size'"),
        ("[[point]]\nname = 'a'\nat_px = [1]", r"places are \[x, y\]"),
        ("[[line]]\nname = 'a'\nfrom_px = [1, 2]\nto_px = [2, 2]", "draw a longer line"),
        ("[[point]]\nname = 'a'\nat_px = [1, nan]", "finite"),
        ("[[point]]\nname = 'a'\nat_px = [1, 2]\n[[point]]\nname = 'a'\nat_px = [5, 2]", "named 2 times"),
        ("[[point]\n", "not valid TOML"),
    ],
)
def test_marks_files(tmp_path: object, text: str, words: str) -> None:
    path = tmp_path / "marks.toml"
    path.write_text(text)
    with pytest.raises(BodyError, match=words):
        load_marks(path)
    with pytest.raises(BodyError, match="cannot be read"):
        load_marks(tmp_path / "none.toml")
