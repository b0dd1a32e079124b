"""Proposed outlines lie on the bodies that move, each on its own, and can be tracked as they are."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests.command_line import run
from tests.vision.motion import smooth_step
from vision.bodies.outlines import load_bodies, signed_distance
from vision.errors import TrackingError
from vision.film.mraw_writer import write_mraw
from vision.film.source import ArrayFilm
from vision.proposals.propose_outlines import propose_bodies
from vision.synthetic import Scene, Sensor, SyntheticBody, background, box, speckle
from vision.tracking.track_film import track_film


def film_of_two() -> tuple[np.ndarray, list[np.ndarray], np.ndarray]:
    """Frames, true outlines and true angles of a beam and of a finger that turns on its end; a third thing rests."""
    beam = SyntheticBody("beam", box(-60.0, -16.0, 80.0, 16.0), speckle((-66.0, -22.0, 86.0, 22.0), 1))
    finger = SyntheticBody("finger", box(-14.0, -70.0, 14.0, 10.0), speckle((-20.0, -76.0, 20.0, 16.0), 2))
    rest = SyntheticBody("rest", box(-20.0, -15.0, 20.0, 15.0), speckle((-26.0, -21.0, 26.0, 21.0), 4))
    scene = Scene([rest, beam, finger], background(170, 230, 3))
    s = smooth_step((np.arange(80) - 14) / 50)
    angle = np.column_stack([0.12 * s, 0.5 * s])
    pin = np.column_stack([90 + 60 * np.cos(angle[:, 0]), 125 - 60 * np.sin(angle[:, 0])])
    sensor, frames = Sensor(2.0, 8, 7), []
    for (a, b), (u, v) in zip(angle, pin, strict=True):
        frames.append(sensor.expose(scene.light(np.array([[[0.0, 45.0, 40.0], [a, 90.0, 125.0], [b, u, v]]]))))
    outlines = [beam.outline(0.0, 90.0, 125.0), finger.outline(0.0, 150.0, 125.0)]
    return np.stack(frames), outlines, angle


def test_each_moving_body_gets_its_outline(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], refused: Callable[..., None]
) -> None:
    frames, outlines, angle = film_of_two()
    film = tmp_path / "film.mraw"
    write_mraw(film, frames, 2000.0)
    out = tmp_path / "bodies.toml"
    assert run("track", film, "--propose-bodies", out) == 0
    said = capsys.readouterr().out
    assert "body1, body2" in said and "bodies.png" in said
    bodies = load_bodies(out)
    assert len(bodies) == 2 and (tmp_path / "bodies.png").stat().st_size > 5000
    true = [signed_distance(outline, 170, 230) > 0 for outline in outlines]
    true[0] &= ~true[1]  # the finger hides the end of the beam
    for mask in true:
        shares = []
        for body in bodies:
            own = signed_distance(body.polygon_px, 170, 230) > 0
            shares.append(((own & mask).sum() / mask.sum(), (own & mask).sum() / own.sum()))
        covered, right = max(shares)
        assert covered > 0.6 and right > 0.85, shares
    result = track_film(film, bodies)
    end = sorted(np.nanmax(result.angle_rad, axis=0))
    np.testing.assert_allclose(end, angle[-1], atol=2e-3)
    refused(str(out), "track", film, "--propose-bodies", out)  # corrected outlines are never overwritten


def test_nothing_moves() -> None:
    frames = film_of_two()[0][:12]
    with pytest.raises(TrackingError, match="by hand"):
        propose_bodies(ArrayFilm(frames, 2000.0))
