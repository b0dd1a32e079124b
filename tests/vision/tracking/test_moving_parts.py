"""An outline over two bodies is named; hidden, disturbed and clean bodies are not."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from tests.vision.known_films import (
    PIVOT,
    Cover,
    bar_motion,
    bar_scene,
    film_of,
    quietly_tracked,
    sliding_bar,
    smooth_step,
)
from vision import ArrayFilm, Body, VisionWarning, track
from vision.synthetic import Scene, Sensor, SyntheticBody, background, box, speckle, wood_grain

N = 90


@pytest.mark.parametrize(("texture", "noise"), [("speckle", 2.0), ("wood", 0.0)])
def test_an_outline_over_two_bodies(texture: str, noise: float) -> None:
    """A beam and an arm hinged to its end, turning by 0.1 and 0.25 rad, under one outline."""
    extent = (-10.0, -24.0, 90.0, 24.0)
    make = [speckle(extent, k) if texture == "speckle" else wood_grain(extent, k, direction_rad=0.2) for k in (1, 2)]
    bodies = [SyntheticBody(name, box(0.0, -18.0, 80.0, 18.0), made) for name, made in zip("ab", make, strict=True)]
    scene = Scene(bodies, background(150, 230, 3))
    s = smooth_step((np.arange(N) - 16) / 60)
    sensor, frames = Sensor(noise, 8, 5), []
    for i in range(N):
        end = np.array([30 + 80 * np.cos(0.1 * s[i]), 75 - 80 * np.sin(0.1 * s[i])])
        frames.append(sensor.expose(scene.light(np.array([[[0.1 * s[i], 30.0, 75.0], [0.25 * s[i], *end]]]))))
    film = ArrayFilm(np.stack(frames), 2000.0)
    with pytest.warns(VisionWarning, match="the outline lies over two"):
        result = track(film, [Body("both", np.array([[30.0, 57.0], [190.0, 57.0], [190.0, 93.0], [30.0, 93.0]]))])
    parts = result.info["moving_parts"]["both"]
    assert parts["share"] > 0.4 and 3.0 < parts["most_px"] < 10.0
    apart = quietly_tracked(
        film, [Body("a", bodies[0].outline(0.0, 30.0, 75.0)), Body("b", bodies[1].outline(0.0, 110.0, 75.0), "a")]
    )
    assert apart.info["moving_parts"] == {}


def test_a_body_that_bends_is_named() -> None:
    """A bar of 120 px whose ends move across its length while it turns, by the square of their place."""
    sag_px, pose, s = -1.5, bar_motion(N, PIVOT, 0.15), smooth_step((np.arange(N) - 16) / 60)

    def bend(i: int, light: np.ndarray) -> None:
        y, x = np.mgrid[0 : light.shape[0], 0 : light.shape[1]].astype(float)
        way = ((x - pose[i, 0, 1] - 25.0) * np.cos(pose[i, 0, 0])) / 50.0
        light[:] = ndimage.map_coordinates(light, [y + sag_px * s[i] * way**2, x], order=3, mode="nearest")

    known = film_of(bar_scene("speckle"), pose, cover=bend)
    with pytest.warns(VisionWarning, match="body bar bends"):
        result = track(known.film, known.bodies)
    parts = result.info["moving_parts"]["bar"]
    assert parts["bends"] and 0.4 * abs(sag_px) < parts["most_px"] < 2.0 * abs(sag_px)


@pytest.mark.parametrize(("texture", "cover"), [("speckle", sliding_bar), ("wood", None)])
def test_a_rigid_body_is_not_named(texture: str, cover: Cover | None) -> None:
    known = film_of(bar_scene(texture), bar_motion(N, PIVOT, 0.3), cover=cover)
    assert quietly_tracked(known.film, known.bodies).info["moving_parts"] == {}
