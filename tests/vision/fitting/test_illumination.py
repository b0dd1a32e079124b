"""The edge of a shadow and a reflection are taken out of the frame; what hides a body is not."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.vision.known_films import PIVOT, bar_scene
from vision import ArrayFilm
from vision.fitting.base import Fit
from vision.fitting.icgn import IcgnFitter
from vision.fitting.template import build_template

START = np.array([0.001, 0.1, -0.1])


def fitted(still: NDArray[np.float64], frame: NDArray[np.float64], seed: int) -> tuple[Fit, IcgnFitter]:
    """The last fit to four frames that show the same."""
    mask = np.zeros(still.shape, dtype=bool)
    mask[76:116, 68:166] = True
    rng = np.random.default_rng(seed)
    film = ArrayFilm(
        np.stack(
            [
                np.clip(np.rint(frame + 2.0 * rng.standard_normal(still.shape)), 0, 255).astype(np.uint8)
                for _ in range(4)
            ]
        )
    )
    fitter = IcgnFitter(build_template("bar", still, mask, 12, noise_grey=2.0))
    pose = START
    for k in range(4):
        fit = fitter.fit(film, k, pose, None)
        pose = fit.pose
    return fit, fitter


@pytest.mark.parametrize(("texture", "kind"), [("speckle", "shade"), ("wood", "shade"), ("wood", "glow")])
def test_light_that_gradients_do_not_follow(texture: str, kind: str) -> None:
    still = bar_scene(texture).light(np.array([[[0.0, *PIVOT]]])).astype(float)
    y, x = np.mgrid[0 : still.shape[0], 0 : still.shape[1]]
    shade = 1.0 - 0.3 / (1.0 + np.exp((x + 0.3 * y - 140.0) / 1.5))
    glow = 35.0 * np.exp(-((x - 140.0) ** 2 + (y - 100.0) ** 2) / (2.0 * 9.0**2))
    fit, fitter = fitted(still, still * shade if kind == "shade" else still + glow, 5)
    assert fit.converged
    light = fitter.state()
    assert light["shade"].size and bool(light["glows"]) == (kind == "glow")
    if kind == "glow":
        assert light["glow"].max() - light["glow"].min() == pytest.approx(35.0, abs=6.0)
    assert fit.seen - fit.inlier < 0.1
    u = np.sqrt(np.diag(fit.covariance))
    assert np.all(np.abs(fit.pose) < 4.0 * u)
    clean, plain = fitted(still, still, 6)
    assert not plain.state()["shade"].size
    assert np.all(u < 1.8 * np.sqrt(np.diag(clean.covariance)))


@pytest.mark.parametrize("grey", [30.0, 85.0, 140.0])
def test_what_hides_a_body_is_no_light(grey: float) -> None:
    still = bar_scene("wood").light(np.array([[[0.0, *PIVOT]]])).astype(float)
    frame = still.copy()
    frame[:, 90:115] = grey
    fit, fitter = fitted(still, frame, 7)
    assert fit.converged and not fitter.state()["shade"].size
    assert fit.seen - fit.inlier > 0.1
    assert np.all(np.abs(fit.pose) < 4.0 * np.sqrt(np.diag(fit.covariance)))


def test_light_goes_on_from_its_state() -> None:
    still = bar_scene("speckle").light(np.array([[[0.0, *PIVOT]]])).astype(float)
    frame = still * np.where(np.arange(still.shape[1]) < 110, 0.75, 1.0)
    _, fitter = fitted(still, frame, 8)
    other = IcgnFitter(fitter.template)
    other.restore(fitter.state())
    film = ArrayFilm(np.clip(np.rint(frame), 0, 255).astype(np.uint8)[None])
    one, same = fitter.fit(film, 0, START, None), other.fit(film, 0, START, None)
    np.testing.assert_array_equal(one.pose, same.pose)
    np.testing.assert_array_equal(one.covariance, same.covariance)
