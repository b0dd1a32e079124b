"""What a film's compression adds to the error of an angle.

Place in the data flow: the readers say how a film is compressed (`Compression`), `error_budget` asks for the
term.

JPEG: every block of 8 x 8 pixels is stored as cosine coefficients rounded to multiples of a table's steps. A
coefficient that is large against its step is off by step / sqrt(12); one that is rounded to nothing is off by
itself. Weighted with the body's own sensitivity, block by block, this gives the standard deviation of the turn
(ITU-T T.81, annex A.3 for the transform). Films that predict a frame from its neighbours follow no such rule:
there the noise term is multiplied by what was measured with H.264 and MPEG-4.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from vision.fitting.template import Template

INTERFRAME_FACTOR = 6.0
"""Error over the noise term with H.264: 3.8 at crf 10, 4.7 at crf 18, 8 at crf 23, textured jack on grey film."""
ZIGZAG = sorted(
    ((row, column) for row in range(8) for column in range(8)),
    key=lambda at: (sum(at), at[0] if sum(at) % 2 else at[1]),
)
"""Rows and columns of the 64 coefficients in the order in which a file stores them (T.81, figure A.6)."""


@dataclass(frozen=True)
class Compression:
    """How a film was compressed.

    Attributes
    ----------
    steps : ndarray, shape (8, 8), or None
        Steps of the luminance table, grey, lowest frequency first; None when frames are predicted from others.
    """

    steps: NDArray[np.float64] | None


def jpeg_steps(data: bytes) -> NDArray[np.float64] | None:
    """Luminance steps of a JPEG picture, shape (8, 8); None when it holds no table."""
    at = data.find(b"\xff\xdb")
    if at < 0 or len(data) < at + 5:
        return None
    kind = np.dtype(">u2") if data[at + 4] >> 4 else np.dtype(np.uint8)
    if len(data) < at + 5 + 64 * kind.itemsize:
        return None
    values = np.frombuffer(data, dtype=kind, count=64, offset=at + 5)
    steps = np.empty((8, 8))
    for (row, column), value in zip(ZIGZAG, values, strict=True):
        steps[row, column] = value
    return steps


def codec_u_turn(
    template: Template, picture: NDArray[Any], compression: Compression | None, u_noise_rad: float
) -> float:
    """Standard uncertainty of a body's turn from the compression, rad."""
    if compression is None:
        return 0.0
    if compression.steps is None:
        return INTERFRAME_FACTOR * u_noise_rad
    import cv2

    columns = np.vstack([template.columns.astype(float), np.ones(template.n_pixels)])
    influence = np.linalg.solve(template.normal, columns)[0]
    height, width = picture.shape
    cols, rows = np.rint(template.offset_px + np.array(template.centre_px)[:, None]).astype(int)
    weight = np.zeros((height, width), dtype=np.float32)
    weight[rows, cols] = influence
    variance = 0.0
    for top in range(rows.min() // 8 * 8, min(rows.max() + 1, height - 7), 8):
        for left in range(cols.min() // 8 * 8, min(cols.max() + 1, width - 7), 8):
            block = weight[top : top + 8, left : left + 8]
            if not block.any():
                continue
            content = cv2.dct(picture[top : top + 8, left : left + 8].astype(np.float32) - np.float32(128.0))
            error = np.minimum(compression.steps**2 / 12.0, content.astype(float) ** 2)
            variance += float(np.sum(cv2.dct(block).astype(float) ** 2 * error))
    # the frame and the reference are both rounded; averaging helps the reference only where noise dithers it
    return float(np.sqrt(2.0 * variance))
