"""Outlines of a film: reading, proposing, saving; tracking it, and single frames of it again."""

from __future__ import annotations

from typing import Any

from pianorig.errors import CommandInputError
from pianorig.page.handlers.reply import Reply
from pianorig.page.outlines.edit import outlines_of, propose, save, track_again
from pianorig.page.outlines.film_subject import FilmSubject, subject_of
from pianorig.page.outlines.marks import save_marks


class Films(Reply):
    """Films that lie on their own in the folder of the sessions."""

    async def get(self) -> None:
        """Send their names."""
        await self.answer(lambda: {"films": self.served.catalogue.films()})


class Outlines(Reply):
    """Outlines of one film."""

    async def get(self, owner: str, number: str) -> None:
        """Send film, outlines and worst frames."""
        await self.answer(lambda: outlines_of(self.subject(owner, number)))

    async def post(self, owner: str, number: str) -> None:
        """Save outlines."""
        content = self.body()
        if content is not None:
            await self.answer(lambda: save(self.subject(owner, number), content.get("bodies")))

    def subject(self, owner: str, number: str) -> FilmSubject:
        """The film that is meant."""
        return subject_of(self.served.catalogue, owner, int(number))


class Proposal(Outlines):
    """Proposed outlines."""

    async def get(self, owner: str, number: str) -> None:
        """Send them; nothing is written."""
        await self.answer(lambda: {"outlines": propose(self.subject(owner, number))})


class Track(Outlines):
    """Tracking a film."""

    async def post(self, owner: str, number: str) -> None:
        """Begin it; send the number of the job."""
        content = self.body()
        if content is not None:
            await self.answer(lambda: self._begin(self.subject(owner, number), owner, content.get("frame_rate_hz")))

    def _begin(self, subject: FilmSubject, owner: str, rate_hz: Any) -> dict[str, Any]:
        words = ["track", str(subject.path), "--bodies", str(subject.bodies), "--allow-truncated", *_rate(rate_hz)]
        if not subject.bodies.is_file():
            raise CommandInputError(f"{subject.bodies.name}: no outlines yet; save them first")
        return self.served.jobs.begin(owner, words)


class TrackFrame(Outlines):
    """Tracking one frame again."""

    async def post(self, owner: str, number: str) -> None:
        """Do it; send which bodies are lost in it."""
        content = self.body()
        if content is not None:
            await self.answer(
                lambda: track_again(self.subject(owner, number), content.get("frame"), content.get("places"))
            )


class Marks(Outlines):
    """Points and lines to follow."""

    async def post(self, owner: str, number: str) -> None:
        """Save them."""
        content = self.body()
        if content is not None:
            await self.answer(lambda: save_marks(self.subject(owner, number), content.get("marks")))


class Follow(Outlines):
    """Following the saved points and lines."""

    async def post(self, owner: str, number: str) -> None:
        """Begin it; send the number of the job."""
        content = self.body()
        if content is not None:
            await self.answer(lambda: self._begin(self.subject(owner, number), owner, content.get("frame_rate_hz")))

    def _begin(self, subject: FilmSubject, owner: str, rate_hz: Any) -> dict[str, Any]:
        words = ["track", str(subject.path), "--marks", str(subject.marks), "--out", str(subject.marks_table)]
        words += ["--allow-truncated", *_rate(rate_hz)]
        if not subject.marks.is_file():
            raise CommandInputError(f"{subject.marks.name}: no points or lines yet; save them first")
        return self.served.jobs.begin(owner, words)


def _rate(rate_hz: Any) -> list[str]:
    """Words for a frame rate that was given."""
    if rate_hz is None:
        return []
    if type(rate_hz) not in (int, float) or not 0.0 < rate_hz < 1e9:
        raise CommandInputError(f"frame rate {str(rate_hz)[:40]}: allowed a positive number of frames/s")
    return ["--frame-rate", repr(rate_hz)]
