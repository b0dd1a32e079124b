"""Films of the data set as pictures: small, lossless, one for each level, in a file that any picture program opens.

The virtual camera sees whippen, jack and repetition lever at half the scale of the bench's own film, around the stroke
only. The pages of a TIFF file are the frames, compressed without loss; `bodies.toml` beside them has the outlines, so
that `pianorig track` makes angles of a film.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import cv2
import numpy as np

import vision
from pianorig.errors import CommandInputError
from pianorig.workflows.bench.record import action_geometry
from pianorig.workflows.dataset.play import FILM_HZ, Played
from rig.simulated import CameraSettings, film_bodies, film_trial
from vision.film.open import open_film

LEVELS = ("forte", "mezzoforte", "mezzo", "mezzopiano", "piano")
SETTINGS = CameraSettings(
    frame_rate_hz=FILM_HZ, width=200, height=152, scale_px_per_m=1600.0, noise_grey=1.0, flicker=0.0
)
BEFORE_S, LONG_S = 0.03, 0.3
"""Filmed are so many seconds before the stroke, and so many in all."""
ADOBE_DEFLATE, PREDICTOR = 8, 2
OUTLINES = "bodies.toml"


def write_film(path: Path, played: Played, seed: int) -> tuple[int, float]:
    """Film a trial.

    Parameters
    ----------
    path : path
        Of the TIFF file; outlines are written beside it.
    played : Played
    seed : int
        Of texture and noise.

    Returns
    -------
    int, float
        Number of frames, and the middle of the first one's exposure on the trial's clock, s.

    Raises
    ------
    CommandInputError
        The file cannot be written.
    """
    times = played.trial.film_time_s
    first = played.start_s - BEFORE_S
    filmed = times[(times >= first) & (times < first + LONG_S)]
    late, geometry = played.truth["film_late_s"], action_geometry(played.motion)
    with tempfile.TemporaryDirectory() as folder:
        raw = Path(folder) / "film.mraw"
        film_trial(raw, filmed, lambda t: played.motion.film_angles_at(t + late), geometry, SETTINGS, seed)
        with open_film(raw) as film:
            frames = [np.array(film.read(k)) for k in range(filmed.size)]
    options = [cv2.IMWRITE_TIFF_COMPRESSION, ADOBE_DEFLATE, cv2.IMWRITE_TIFF_PREDICTOR, PREDICTOR]
    if not cv2.imwritemulti(str(path), frames, options):
        raise CommandInputError(f"{path}: the film cannot be written; name another folder")
    vision.save_bodies(path.with_name(path.stem + "_" + OUTLINES), film_bodies(geometry, SETTINGS))
    return filmed.size, float(filmed[0])
