"""The film that a request is about: that of a trial, or one on its own; where its outlines and angles are."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from pianorig.page.catalogue.catalogue import Catalogue, UnknownName
from pianorig.page.catalogue.session_row import open_session
from pianorig.page.review.film_view import outlined_film
from pianorig.workflows.film.session_film import BODIES_NAME, STEP, SessionFilm
from rig.session import Session, Trial

MARKS_NAME = "marks.toml"
"""Points and lines of a session's films, beside its outlines."""

Found = tuple[pd.DataFrame, dict[str, Any]]


@dataclass(frozen=True)
class FilmSubject:
    """A film; ``owner`` is its session and trial, None for a film on its own."""

    path: Path
    bodies: Path
    owner: tuple[Session, Trial] | None

    @property
    def table(self) -> Path:
        """Where ``pianorig track`` writes the angles."""
        return self.path.with_suffix(".angles.csv")

    @property
    def marks(self) -> Path:
        """The file of points and lines to follow."""
        return self.path.with_suffix(".marks.toml") if self.owner is None else self.bodies.with_name(MARKS_NAME)

    @property
    def marks_table(self) -> Path:
        """Where the page has the followed marks written."""
        return self.path.with_suffix(".marks.csv")

    def film(self, frame_rate_hz: float | None = None) -> SessionFilm:
        """The film as tracking takes it."""
        return SessionFilm(self.path, self.bodies, frame_rate_hz, allow_truncated=True)

    def angles(self) -> Found | None:
        """Tracked angles and how they were found; None before tracking."""
        if self.owner is not None:
            session, trial = self.owner
            return session.read_derived(STEP, trial.number)
        if not self.table.is_file():
            return None
        return pd.read_csv(self.table), {}

    def view(self) -> dict[str, Any]:
        """The film for the page (`pianorig.page.review.film_view`)."""
        return outlined_film(self.film(), self.angles())


def subject_of(catalogue: Catalogue, owner: str, number: int) -> FilmSubject:
    """The film of a trial of a session, or with the number 0 a film on its own.

    Raises
    ------
    UnknownName : there is no such film
    rig.errors.RigInputError : the session cannot be read
    """
    if number == 0:
        path = catalogue.film(owner)
        return FilmSubject(path, path.with_suffix(".bodies.toml"), None)
    session = open_session(catalogue.folder(owner))
    trial = session.trial(number)
    if trial.film is None:
        raise UnknownName(f"{owner}: trial {number} has no film")
    return FilmSubject(trial.film, session.path / BODIES_NAME, (session, trial))
