"""One trial: its curves and drawing, its film's outlines and frames."""

from __future__ import annotations

from typing import Any

from tornado.ioloop import IOLoop

import vision
from pianorig.errors import CommandInputError
from pianorig.page.action.changed_action import built_in_actions
from pianorig.page.catalogue.catalogue import UnknownName
from pianorig.page.catalogue.session_row import open_session
from pianorig.page.handlers.reply import Reply
from pianorig.page.review.film_view import film_view
from pianorig.page.review.trial_view import MOST_MODELS, trial_view
from pianorig.player.animation import animation_html
from pianorig.player.shown import trial_animation
from rig.errors import RigError
from rig.session import Session, Trial

MOST_FRAMES = 16


class Review(Reply):
    """Curves, events and drawing of a trial."""

    async def get(self, name: str, number: str) -> None:
        """Send them."""
        await self.answer(self._view, name, int(number), self.get_query_arguments("model"))

    def _view(self, name: str, number: int, models: list[str]) -> dict[str, Any]:
        known = built_in_actions()
        wrong = next((one for one in models if one not in known), None)
        if wrong is not None or len(models) > MOST_MODELS:
            raise CommandInputError(f"model {wrong!r}: allowed at most {MOST_MODELS} of {', '.join(known)}")
        session = open_session(self.served.catalogue.folder(name))
        return trial_view(session, number, models or known[:1])


class TrialAnimation(Review):
    """The trial as an animation to keep."""

    async def get(self, name: str, number: str) -> None:
        """Send the text of the file; nothing is written."""
        await self.answer(self._text, name, int(number), self.get_query_arguments("model"))

    def _text(self, name: str, number: int, models: list[str]) -> dict[str, str]:
        animation = trial_animation(self._view(name, number, models))
        if animation is None:
            raise CommandInputError(f"{name}, trial {number}: no model moves it, so there is nothing to draw")
        return {"text": animation_html(animation)}


class Film(Reply):
    """Size, frame times and outlines of a trial's film."""

    async def get(self, name: str, number: str) -> None:
        """Send them; a film that cannot be read is an ``error`` beside what can be shown."""
        await self.answer(self._view, name, int(number))

    def _view(self, name: str, number: int) -> dict[str, Any]:
        session, trial = self._trial(name, number)
        try:
            return {"film": film_view(session, trial), "error": None}
        except (vision.VisionError, RigError, OSError) as error:
            return {"film": None, "error": f"film: {error}"}

    def _trial(self, name: str, number: int) -> tuple[Session, Trial]:
        session = open_session(self.served.catalogue.folder(name))
        return session, session.trial(number)


class Frames(Film):
    """Some frames."""

    async def get(self, name: str, number: str, first: str = "0", count: str = "1") -> None:
        """Send their grey values; the address names the film's version, so the browser may keep them."""
        if not 1 <= int(count) <= MOST_FRAMES:
            self.refuse(400, f"{count} frames: allowed 1 to {MOST_FRAMES}")
            return
        try:
            grey = await IOLoop.current().run_in_executor(
                self.served.workers, self._frames, name, int(number), int(first), int(count)
            )
        except (vision.VisionError, RigError, OSError, UnknownName) as error:
            self.refuse(404, " ".join(str(error).split()))
            return
        self.set_header("Content-Type", "application/octet-stream")
        self.set_header("Cache-Control", "private, max-age=3600")
        self.finish(grey)

    def _frames(self, name: str, number: int, first: int, count: int) -> bytes:
        if number == 0:
            return self.served.films.frames(self.served.catalogue.film(name), first, count)
        folder = self.served.catalogue.folder(name)
        film = Trial(folder / f"trial_{number:04d}.h5", number, None).film
        if film is None:
            raise UnknownName(f"{name}: trial {number} has no film")
        return self.served.films.frames(film, first, count)
