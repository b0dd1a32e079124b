"""What a first demo compiles beyond the step loop and its scenes: called in a process beside it, on tiny inputs."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

import model
import vision
from pianorig.workflows.examples import write_blow_film
from validation.scores.iso18571 import iso_score

BEGINS_S = 0.15  # of the blow, enough for all that is compiled
FRAMES = 40  # of a film: enough for all that is compiled


def call_once() -> None:
    """Simulate, film, track and score a short blow once, so that the compiled kernels of model, tracker and scores are
    on disk; nothing else stays."""
    action = model.load_action()
    times, force = model.force_table("forte")
    begins = times <= BEGINS_S
    blow = model.simulate(action, times[begins], force[begins], tolerance=1e-3)
    with tempfile.TemporaryDirectory() as folder:
        film, bodies = Path(folder) / "film.mraw", Path(folder) / "bodies.toml"
        write_blow_film(film, bodies, blow, FRAMES)
        vision.track(film, vision.load_bodies(bodies))
    model.null_model.simulate(action, times[begins], force[begins])
    hammer = np.ascontiguousarray(blow.angle_rad[:, -1])
    iso_score(hammer, 1.01 * hammer, float(times[1] - times[0]))  # any other curve
