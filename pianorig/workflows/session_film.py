"""A film and the session it belongs to: its trial, its outlines, its frame times, and where its angles are stored."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

import vision
from pianorig.errors import CommandInputError
from rig import Session, Trial
from rig.atomic_write import sha256_of_file
from rig.session.film_record import frame_times, read_record

if TYPE_CHECKING:  # start-up: 0.3 s of every recording, which needs no table
    import pandas as pd

BODIES_NAME = "bodies.toml"
STEP = "angles"


@dataclass(frozen=True)
class SessionFilm:
    """A film to track, and what its file does not say.

    Attributes
    ----------
    path : film file
    bodies_file : TOML with outlines; by default the session's
    frame_rate_hz : rate of a film on its own that does not say it, or says its play-back rate
    allow_truncated : read a film that was cut short up to its last whole frame
    channel : of a colour film, red, green or blue; of a TIFF's channels, the number of one
    first_frame, last_frame : frames that are used; all by default
    """

    path: Path
    bodies_file: Path | None = None
    frame_rate_hz: float | None = None
    allow_truncated: bool = False
    channel: str | None = None
    first_frame: int = 0
    last_frame: int | None = None

    @property
    def is_part(self) -> bool:
        """Whether some of its frames are chosen."""
        return self.first_frame != 0 or self.last_frame is not None

    def open_whole(self, allow_truncated: bool | None = None) -> vision.Film:
        """All frames of the film; to be closed."""
        whole = self.allow_truncated if allow_truncated is None else allow_truncated
        return vision.open_film(self.path, allow_truncated=whole, channel=self.channel)

    def open(self) -> vision.Film:
        """Open the film at the chosen frames alone, numbered from the first of them, 0; the caller closes it."""
        film = self.open_whole()
        if not self.is_part:
            return film
        # start-up: 0.1 s of every recording, which reads no film
        from vision.film.source import ChosenFrames

        try:
            return ChosenFrames(film, self.first_frame, self.last_frame)
        except vision.FilmError as error:
            film.close()
            raise vision.FilmError(f"{error}; choose others with --from and --to") from None

    @cached_property
    def owner(self) -> tuple[Session, Trial] | None:
        """Session and trial that the film lies beside, or None for a film on its own."""
        if not self.path.with_suffix(".h5").is_file() or not (self.path.parent / "session.toml").is_file():
            return None
        session = Session.open(self.path.parent)
        for trial in session.trials:
            if trial.film is not None and trial.film.resolve() == self.path.resolve():
                return session, trial
        return None

    @cached_property
    def outlines(self) -> Path:
        """Path of the film's outlines file, which need not exist: the one named, else its session's; CommandInputError
        for a film that is not there, or on its own without a named file.

        Raises
        ------
        CommandInputError : there is no such film, or it belongs to no session and no file is named
        """
        if not self.path.exists():
            raise CommandInputError(f"{self.path}: no such film")
        if self.bodies_file is not None:
            return self.bodies_file
        if self.owner is None:
            raise CommandInputError(
                f"{self.path}: does not belong to a session; name its outlines with --bodies B.toml"
            )
        return self.owner[0].path / BODIES_NAME

    def frame_times(self, source: vision.Film) -> tuple[NDArray[np.float64] | None, float]:
        """Times of the frames of ``source``, s, by the trial's frame clock or the rate named; None where the film's own
        times apply; and their standard uncertainty, s. CommandInputError where nothing tells them."""
        # start-up: 0.1 s of every recording, which reads no film
        from vision.film.source import Corrected

        rate_hz = self.frame_rate_hz
        if self.owner is not None:
            if rate_hz is not None:
                raise CommandInputError(
                    f"{self.path}: belongs to a trial whose frame clock gives its times; leave out --frame-rate"
                )
            whole = source.film if isinstance(source, Corrected) else source
            times, u_time = frame_times(self.owner[1], whole)
            return times[self.first_frame :][: source.n_frames], u_time
        if rate_hz is None:
            if source.frame_time_s is None:
                raise CommandInputError(f"{self.path}: the film states no frame rate; give it with --frame-rate")
            return None, 0.0
        return vision.frame_times_at_rate(source, rate_hz), 0.0

    @property
    def doubt_about_times(self) -> str | None:
        """Sentence that the times rest on the rate a video file states, which is often that of play-back; None where a
        trial's clock or a named rate gives them, or it is no video."""
        # start-up: 0.1 s of every recording, which reads no film
        from vision.film.open import VIDEO_SUFFIXES

        video = self.path.suffix.lower() in VIDEO_SUFFIXES
        if not video or self.owner is not None or self.frame_rate_hz is not None:
            return None
        with self.open_whole(allow_truncated=True) as source:
            rate_hz = source.frame_rate_hz
        if rate_hz is None:
            return None
        return (
            f"{self.path}: times are from the rate in the file, {rate_hz:g} frames/s; in a video file that is often "
            "the rate of play-back: give the true one with --frame-rate"
        )

    def store_angles(self, table: pd.DataFrame, attributes: dict[str, Any]) -> None:
        """Write a table of angles into the film's session, with ``attributes`` and the SHA-256 of film, outlines and
        trial; nothing for a film on its own. CommandInputError where the film was altered since it was attached."""
        if self.owner is None:
            return
        session, trial = self.owner
        digest = sha256_of_file(self.path)
        attached = read_record(self.path)
        if attached is not None and attached.sha256 != digest:
            raise CommandInputError(
                f"{self.path}: SHA-256 {digest}, attached with {attached.sha256}; it was altered since: take it "
                "away, with its .film.toml, and attach the original again"
            )
        made_from = {self.path.name: digest, self.outlines.name: sha256_of_file(self.outlines)}
        session.write_derived(STEP, trial.number, table, attributes, {**made_from, trial.path.name: trial.sha256})
