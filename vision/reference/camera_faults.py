"""Camera faults: defect pixels, row flicker, coarse quantisation, blocks that a codec skips.

Defect pixels, always bright or always dark, are replaced by their neighbours. In the reference such a pixel has by far
the steepest slopes, which do not move with the body: the fit is held back and thinks itself more certain than it is. A
pixel is taken for a defect where it differs from its neighbours by far more than pixels do, in the same sense in frames
from all over the film. A film without any is not touched.

Row flicker, light that differs between even and odd rows, is taken off before anything is fitted. A camera that reads
two half pictures one after the other sees a flickering lamp twice: even rows are brighter by some per cent, or darker,
another amount in each frame. No gain and no gradient follows that; it counts as noise, widens the uncertainty and ends
the still frames. Method: the median, over a row and then over the rows, of what pixels differ by from the mean of their
neighbours, over that mean, is the amplitude; texture adds the same to all frames at rest, so that a film is touched
only where the amplitude changes among its first frames by far more than pixels explain.

Coarse steps of grey: a film whose grey values were rounded to steps that its noise does not blur shows a contour where
there was a slope; contours move with the body by whole pixels at a time, and residuals do not tell how far that moves
the pose. Films in steps are known by the grey values that occur.

Skipped blocks tell of heavy compression of which the file says nothing. Codecs that predict frames (MPEG-4, H.264)
leave out squares of 16 pixels that hardly change: the next frame repeats them byte for byte, however noisy the camera
is, and what moves slowly is shown standing still, which no residual tells. JPEG repeats squares of 8 pixels; four at
once only where its quality is so low that the same care is needed.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.film.source import FIRST_FRAMES, Corrected, FrameSource, saturated_grey
from vision.fitting.base import MEDIAN_U, ROUNDING_GREY, SURE_U
from vision.fitting.template import Template
from vision.reference.rectified_film import RectifiedFilm

USUAL_PERCENT = 98.0  # of pixels: defects are fewer than the rest
FAR = 2.5  # difference from the median of three by three, over that which 98 of 100 pixels do not reach
LEAST_GREY = 12.0  # smallest such difference, of 255
FRAMES = 48  # that are looked at, spread over a film that need not be decoded in order
CHANGED = 4  # of them, those in which a pixel's neighbours have changed most
OUT = 0.3  # of its difference from them in the first frame, by which a defect still differs in most of these
MOST_SHARE = 0.01  # of all pixels; more are a texture, not defects
NEIGHBOURS = np.array([[1, 1, 1], [1, 0, 1], [1, 1, 1]], dtype=np.uint8)
"""A defect stands alone: beyond every one of them by half as much as beyond their median."""
AROUND = ((-1, -1), (-1, 0), (-1, 1), (0, -1), (0, 1), (1, -1), (1, 0), (1, 1))


class DefectCorrectedFilm(Corrected):
    """A film whose defect pixels (rows, columns) have the median grey value of their neighbours."""

    def __init__(self, film: FrameSource, rows: NDArray[np.intp], columns: NDArray[np.intp]) -> None:
        super().__init__(film)
        self.rows, self.columns = rows, columns

    def read_region(self, index: int, y0: int, y1: int, x0: int, x1: int) -> NDArray[Any]:
        grey = np.array(self.film.read_region(index, y0, y1, x0, x1))
        inside = (self.rows >= y0) & (self.rows < y1) & (self.columns >= x0) & (self.columns < x1)
        rows, columns = self.rows[inside] - y0, self.columns[inside] - x0
        grey[rows, columns] = np.median(_neighbours(grey, rows, columns), axis=0)
        return grey


def _neighbours(grey: NDArray[Any], rows: NDArray[np.intp], columns: NDArray[np.intp]) -> NDArray[Any]:
    last_y, last_x = grey.shape[0] - 1, grey.shape[1] - 1
    return np.stack([grey[np.clip(rows + dy, 0, last_y), np.clip(columns + dx, 0, last_x)] for dy, dx in AROUND])


def correct_defects(film: FrameSource) -> FrameSource:
    """The film with its defective pixels (far brighter or darker than their neighbours, wherever these change)
    interpolated; the film itself where it has none."""
    # of a film that must be decoded in order only the beginning is near
    last = min(FIRST_FRAMES if getattr(film, "in_order", True) else film.n_frames, film.n_frames) - 1
    first, late = (_classify_outliers(film.read(k), film.bit_depth) for k in (0, last))
    if not 0 < np.count_nonzero(first) <= MOST_SHARE * first.size:
        return film
    rows, columns = np.nonzero((first != 0) & (first == late))
    stays = _is_fixed(film, rows, columns, last) if rows.size else np.zeros(0, dtype=bool)
    return DefectCorrectedFilm(film, rows[stays], columns[stays]) if stays.any() else film


def _is_fixed(film: FrameSource, rows: NDArray[np.intp], columns: NDArray[np.intp], last: int) -> NDArray[np.bool_]:
    """Which of the pixels at ``rows``, ``columns`` (k,) still differ from their neighbours where these have changed, in
    frames up to ``last``: texture of a body that rests in most frames goes with them."""
    beside, off = [], []
    for k in np.unique(np.linspace(0, last, FRAMES).astype(int)):
        grey = film.read(int(k))
        light = float(np.median(grey[::8, ::8])) + 1.0
        beside.append(_neighbours(grey, rows, columns) / light)
        off.append(grey[rows, columns] / light - np.median(beside[-1], axis=0))
    out = np.array(off) * np.sign(off[0]) > OUT * np.abs(off[0])
    most = np.argsort(-np.abs(np.array(beside) - beside[0]).sum(axis=1), axis=0, kind="stable")[:CHANGED]
    return np.asarray(2 * np.take_along_axis(out, most, axis=0).sum(axis=0) > len(most))


def _classify_outliers(frame: NDArray[Any], bit_depth: int) -> NDArray[np.int8]:
    """Map (height, width): 1 where a pixel of a frame is far brighter than its neighbours, -1 where far
    darker, else 0."""
    grey = np.ascontiguousarray(frame)
    if grey.dtype not in (np.uint8, np.uint16):
        return np.zeros(grey.shape, dtype=np.int8)
    off = grey.astype(np.int32) - cv2.medianBlur(grey, 3)
    above, below = (
        grey.astype(np.int32) - cv2.dilate(grey, NEIGHBOURS),
        cv2.erode(grey, NEIGHBOURS) - grey.astype(np.int32),
    )
    limit = max(FAR * float(np.percentile(np.abs(off), USUAL_PERCENT)), LEAST_GREY * 2.0 ** (bit_depth - 8))
    bright, dark = (off > limit) & (above > 0.5 * limit), (off < -limit) & (below > 0.5 * limit)
    return bright.astype(np.int8) - dark.astype(np.int8)


LEAST = 0.002  # smallest scatter that matters: a quarter of a grey level in a hundred


class FlickerCorrectedFilm(Corrected):
    """A film whose even and odd rows are brought to the same light, frame by frame; saturated pixels stay so.

    Grey values are float32. ``box`` (y0, y1, x0, x1) is where the light is looked at.
    """

    def __init__(self, film: FrameSource, box: tuple[int, int, int, int]) -> None:
        super().__init__(film)
        self.box, self._top = box, saturated_grey(film)
        self._amplitudes: dict[int, float] = {}

    def amplitude(self, index: int) -> float:
        """By how much the even rows of a frame are brighter than the mean of all, as a share."""
        if index not in self._amplitudes:
            grey = self.film.read_region(index, *self.box)
            self._amplitudes[index] = row_flicker_share(grey, self.box[0], self._top)[0]
        return self._amplitudes[index]

    def read_region(self, index: int, y0: int, y1: int, x0: int, x1: int) -> NDArray[Any]:
        grey = self.film.read_region(index, y0, y1, x0, x1)
        factor = (1.0 / (1.0 + self.amplitude(index) * row_parity(y0, y1))).astype(np.float32)
        return np.where(grey >= self._top, np.float32(self._top), grey * factor[:, None])


def correct_row_flicker(film: FrameSource, box: tuple[int, int, int, int]) -> FrameSource:
    """The film itself, or one that evens out even against odd rows, where their difference in light flickers inside a
    rectangle (y0, y1, x0, x1) of the first frames."""
    if film.n_frames < 3 or box[1] - box[0] < FIRST_FRAMES:
        return film
    top = saturated_grey(film)
    frames = range(min(FIRST_FRAMES, film.n_frames))
    amplitude, u = np.array([row_flicker_share(film.read_region(k, *box), box[0], top) for k in frames]).T
    changing = float(np.std(amplitude))
    return FlickerCorrectedFilm(film, box) if changing > max(LEAST, SURE_U * float(u.max())) else film


def row_parity(y0: int, y1: int) -> NDArray[np.float64]:
    return np.asarray(1.0 - 2.0 * (np.arange(y0, y1) % 2), dtype=np.float64)


def row_flicker_share(grey: NDArray[Any], first_row: int, top: int) -> tuple[float, float]:
    """Share by which the even rows of a rectangle (h, w), whose first is row ``first_row`` of the frame, are brighter
    than the mean of all, and its standard uncertainty; 0 and infinity if unknown. Pixels from ``top`` on are left out.
    """
    light = np.asarray(grey, dtype=np.float64)
    beside = light[:-2] + light[2:]
    # of a row and its neighbours, the mean does not change with the amplitude and the difference is all of it
    mean, off = 0.25 * (2.0 * light[1:-1] + beside), 0.25 * (2.0 * light[1:-1] - beside)
    off *= row_parity(first_row + 1, first_row + grey.shape[0] - 1)[:, None]
    below = light < top
    use = below[1:-1] & below[:-2] & below[2:] & (mean > 0.0)
    whole = use.any(axis=1)
    use, off, mean = use[whole], off[whole], mean[whole]
    if len(off) < 2:
        return 0.0, float("inf")
    # row by row: what a row is read with is common to its pixels
    share = np.nanmedian(np.where(use, off / np.where(use, mean, 1.0), np.nan), axis=1)
    middle = float(np.median(share))
    scatter = 1.4826 * float(np.median(np.abs(share - middle)))
    return middle, MEDIAN_U * scatter / float(np.sqrt(share.size))


OF_TEXTURE = 0.25  # step over the texture's standard deviation from which it is coarse
OF_NOISE = 2.0  # step over the noise from which it is not blurred


def find_grey_step(film: FrameSource, box: tuple[int, int, int, int]) -> float:
    """Smallest step between grey values of the first recorded frame in a rectangle (y0, y1, x0, x1); corrections are
    undone, and a rectified film is searched whole; inf with fewer than two values."""
    while hasattr(film, "film"):  # what was taken off a frame has no steps
        if isinstance(film, RectifiedFilm):
            box = (0, film.film.height, 0, film.film.width)
        film = film.film
    values = np.unique(film.read_region(0, *box))
    return float(np.diff(values.astype(np.float64)).min()) if values.size > 1 else np.inf


def is_coarsely_quantised(template: Template, step: float) -> bool:
    """Whether a body is seen in steps of grey that neither its texture nor its noise make fine."""
    return step > OF_TEXTURE * float(np.std(template.columns[3])) and step > OF_NOISE * template.noise_grey


BLOCK_PX = 16  # side of a codec's macroblock
PAIRS = 8  # of neighbouring frames that are compared, spread over the film
TEXTURE_GREY = 3.0  # least standard deviation in a square that is looked at: flat ones may repeat
LEAST_SKIPPED = 0.015
"""Share of repeated squares from which a codec is believed: MPEG-4 gave 0.02 to 0.2, JPEG of quality 50 and more 0."""


def skips_blocks(film: FrameSource, box: tuple[int, int, int, int], noise_grey: float) -> bool:
    """Whether a codec repeats textured squares of the previous frame inside a rectangle (y0, y1, x0, x1); False where
    the film states its compression or nearly lacks noise (``noise_grey``) and repeats whole pictures."""
    if film.compression is not None or film.n_frames < 3:
        return False
    # and the squares next to it
    y0, x0 = (max(0, (edge // BLOCK_PX - 1) * BLOCK_PX) for edge in (box[0], box[2]))
    y1 = min(film.height // BLOCK_PX, -(-box[1] // BLOCK_PX) + 1) * BLOCK_PX
    x1 = min(film.width // BLOCK_PX, -(-box[3] // BLOCK_PX) + 1) * BLOCK_PX
    if y1 <= y0 or x1 <= x0:
        return False
    if noise_grey < ROUNDING_GREY:  # pictures may repeat by themselves
        # a codec may leave most pixels at rest unchanged, but never all of them for long
        first = [film.read_region(k, y0, y1, x0, x1) for k in range(min(FIRST_FRAMES, film.n_frames))]
        if any(np.array_equal(one, other) for one, other in zip(first, first[1:], strict=False)):
            return False
    shares = []
    for index in np.unique(np.linspace(1, film.n_frames - 1, PAIRS).astype(int)):
        before, here = (film.read_region(int(k), y0, y1, x0, x1) for k in (index - 1, index))
        textured = _squares(here).std(axis=-1) > TEXTURE_GREY
        # a frame that is repeated as a whole tells nothing
        if textured.any() and not np.array_equal(before, here):
            shares.append(float(np.mean(_squares(np.equal(before, here))[textured].all(axis=-1))))
    return bool(shares) and float(np.mean(shares)) > LEAST_SKIPPED


def _squares(picture: NDArray[Any]) -> NDArray[Any]:
    """Pixels of every square, (rows, columns, 256)."""
    rows, columns = (size // BLOCK_PX for size in picture.shape)
    squares = picture.reshape(rows, BLOCK_PX, columns, BLOCK_PX).swapaxes(1, 2)
    return squares.reshape(rows, columns, BLOCK_PX * BLOCK_PX)
