"""Rendered pictures against the formula they are drawn from."""

from __future__ import annotations

import numpy as np

from vision.synthetic import Scene, SyntheticBody, box, speckle


def test_drawn_body_is_the_formula() -> None:
    """A rendered picture against the texture's formula at the back-rotated pixel, away from the edge."""
    texture = speckle((-30.0, -20.0, 60.0, 20.0), 3)
    scene = Scene([SyntheticBody("plate", box(-25, -15, 55, 15), texture)], np.zeros((80, 130), dtype=np.float32))
    angle, x0, y0 = 0.31, 48.3, 41.7
    picture = scene.light(np.array([[[angle, x0, y0]]]))
    y, x = np.mgrid[0:80, 0:130].astype(float)
    # counter-clockwise by `angle` with y down: body axes from picture axes
    u = np.cos(angle) * (x - x0) - np.sin(angle) * (y - y0)
    v = np.sin(angle) * (x - x0) + np.cos(angle) * (y - y0)
    inner = (u > -23) & (u < 53) & (v > -13) & (v < 13)
    np.testing.assert_allclose(picture[inner], texture.evaluate(u[inner], v[inner]), atol=0.03)
    outer = (u < -27) | (u > 57) | (v < -17) | (v > 17)
    assert np.all(picture[outer] == 0.0)
