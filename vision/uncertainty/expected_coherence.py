"""Coherence of the residuals that a calibrated camera explains.

Tilt and distortion displace the pixels of a body in a way that no rigid motion follows; what is left is coherent, but
known, and the angle is corrected for it (`vision.uncertainty.pose_response`). It must not widen the uncertainty again.
Method: the residuals of that displacement, to first order, are put through the blocks of `vision.fitting.coherence`;
the ratio is found for `MOST_ROWS` rows and interpolated between them.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vision.camera.projection import Projection
from vision.fitting.coherence import N_LEVELS, blocks_of, ratios_of
from vision.fitting.template import Template, invert_normal
from vision.uncertainty.pose_response import displacement

MOST_ROWS = 60


def expected_ratio(
    template: Template, camera: Projection, pose: NDArray[np.float64], white_variance: NDArray[np.float64]
) -> NDArray[np.float64]:
    """What the camera adds to the ratio of each row.

    Parameters
    ----------
    template : Template
    camera : Projection
        Calibrated.
    pose, white_variance : ndarray, shape (n, 3)
        Tracked poses and their variances by white noise; NaN where lost.

    Returns
    -------
    ndarray, shape (n, 3, 3)
        By size of block and direction; zero where nothing is known.
    """
    added = np.zeros((len(pose), N_LEVELS, 3))
    known = np.flatnonzero(np.all(np.isfinite(pose), axis=1) & np.all(white_variance > 0.0, axis=1))
    inverse = invert_normal(template.normal)
    if not known.size or inverse is None:
        return added
    rows = known[np.unique(np.linspace(0, known.size - 1, MOST_ROWS).astype(int))]
    design = np.vstack([template.columns.astype(float), np.ones(template.n_pixels)])
    blocks = blocks_of(template.offset_px)
    work, weight = np.ones((3, template.n_pixels), dtype=np.float32), np.ones(template.n_pixels, dtype=np.float32)
    found = np.empty((rows.size, N_LEVELS, 3))
    for k, row in enumerate(rows):
        along, across = displacement(template, camera, pose[row])
        residual = design[1] * along + design[2] * across
        residual -= (inverse @ (design @ residual)) @ design
        work[2] = residual
        found[k] = ratios_of(blocks, template.columns, work, weight, inverse[:3], white_variance[row]).ratio
    for level in range(N_LEVELS):
        for axis in range(3):
            added[:, level, axis] = np.interp(np.arange(len(pose)), rows, found[:, level, axis])
    return added
