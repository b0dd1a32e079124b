"""The table of sessions, one of them, its annotations, its report, and the making of a report."""

from __future__ import annotations

from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, cast, get_args

from tornado.ioloop import IOLoop

import rig
from pianorig.errors import CommandInputError
from pianorig.page.catalogue.catalogue import COMPARISONS, UnknownName
from pianorig.page.catalogue.session_row import open_session, read_row, session_detail
from pianorig.page.handlers.reply import Reply
from rig.session.annotation_file import Kind

LONGEST_TEXT = 2000
MOST_COMPARED = 8
REPORT_POLICY = (
    "sandbox allow-scripts allow-downloads allow-popups; default-src 'none'; script-src 'unsafe-inline'; "
    "style-src 'unsafe-inline'; img-src data: blob:; font-src data:; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'self'"
)
"""A report is a file of the session, and a session may come from anybody: its scripts run in an origin of their own,
which may neither read this page nor ask it or the network for anything."""


class Sessions(Reply):
    """All sessions."""

    async def get(self) -> None:
        """Send the rows of the table."""
        await self.answer(lambda: {"sessions": [asdict(row) for row in self.served.catalogue.rows()]})


class OneSession(Reply):
    """One session."""

    async def get(self, name: str) -> None:
        """Send its row, trials and annotations."""
        await self.answer(self._detail, name)

    def _detail(self, name: str) -> dict[str, Any]:
        folder = self.served.catalogue.folder(name)
        row = read_row(folder)
        detail: dict[str, Any] = {"trials": [], "annotations": []}
        if row.status != "unreadable":
            detail = session_detail(folder)
        return {**asdict(row), **detail}


class Annotations(Reply):
    """Notes, rejections and acceptances."""

    async def post(self, name: str) -> None:
        """Append one; send the session as it is then."""
        content = self.body()
        if content is not None:
            await self.answer(self._append, name, content)

    def _append(self, name: str, content: dict[str, Any]) -> dict[str, Any]:
        folder = self.served.catalogue.folder(name)
        annotate(folder, content)
        return {"annotated": True}


def annotate(folder: Path, content: dict[str, Any]) -> None:
    """Append one annotation to a session, as ``pianorig annotate`` does.

    Parameters
    ----------
    content : trial (0: the session), kind, reason, author

    Raises
    ------
    CommandInputError : a field that cannot be used
    rig.errors.RigInputError : the session or the trial cannot be annotated
    """
    trial, kind, reason, author = (content.get(key) for key in ("trial", "kind", "reason", "author"))
    if type(trial) is not int or trial < 0:
        raise CommandInputError(f"trial {trial!r}: allowed 0 for the session, or the number of a trial")
    if kind not in get_args(Kind):
        raise CommandInputError(f"kind {kind!r}: allowed {', '.join(get_args(Kind))}")
    for label, text in (("reason", reason), ("author", author)):
        if not isinstance(text, str) or len(text) > LONGEST_TEXT:
            raise CommandInputError(f"{label}: allowed is text of at most {LONGEST_TEXT} characters")
    session = open_session(folder)
    if trial and kind == "accept" and session.trial(trial).rejected is None:
        raise CommandInputError(f"trial {trial} is not rejected; nothing to accept")
    session.annotate(trial, cast(Kind, kind), str(reason), author=str(author))


class Report(Reply):
    """The report of a session and the files beside it."""

    def found(self, name: str, path: str) -> tuple[Path, str]:
        """The file and its media type."""
        return self.served.catalogue.report_file(name, path)

    async def get(self, name: str, path: str) -> None:
        """Send one file, boxed in."""
        try:
            file, kind = self.found(name, path or "report.html")
        except UnknownName as error:
            self.refuse(404, str(error))
            return
        self.set_header("Content-Security-Policy", REPORT_POLICY)
        self.set_header("X-Frame-Options", "SAMEORIGIN")
        self.set_header("Content-Type", kind)
        self.finish(await IOLoop.current().run_in_executor(self.served.workers, file.read_bytes))


class ComparisonReport(Report):
    """The report of several sessions and the files beside it."""

    def found(self, name: str, path: str) -> tuple[Path, str]:
        """The file and its media type."""
        return self.served.catalogue.comparison_file(name, path)


class Comparisons(Reply):
    """Reports of several sessions side by side."""

    async def get(self) -> None:
        """Send their names."""
        await self.answer(lambda: {"comparisons": self.served.catalogue.comparisons()})

    async def post(self) -> None:
        """Begin one; send the number of the job."""
        content = self.body()
        if content is not None:
            await self.answer(self._begin, content.get("sessions"))

    def _begin(self, names: Any) -> dict[str, Any]:
        several = isinstance(names, list) and all(isinstance(name, str) for name in names)
        if not several or not 2 <= len(set(names)) <= MOST_COMPARED:
            raise CommandInputError(f"sessions to compare: allowed 2 to {MOST_COMPARED} names")
        folders = [self.served.catalogue.folder(name) for name in dict.fromkeys(names)]
        for folder in folders:
            rig.Session.open(folder)
        out = self.served.catalogue.root / COMPARISONS / f"{datetime.now(UTC):%Y-%m-%dT%H%M%SZ}"
        return self.begin(out.name, ["validate", *map(str, folders), "--out", str(out)])


class Validate(Reply):
    """Making a session's report."""

    async def post(self, name: str) -> None:
        """Begin it; send the number of the job."""
        content = self.body()
        if content is not None:
            await self.answer(self._begin, name)

    def _begin(self, name: str) -> dict[str, Any]:
        folder = self.served.catalogue.folder(name)
        rig.Session.open(folder)  # what cannot be compared is refused before a process is started
        return self.begin(name, ["validate", str(folder)])


class Job(Reply):
    """A job that was begun."""

    def get(self, number: str) -> None:
        """Send how far it is."""
        found = self.served.jobs.state(int(number))
        if found is None:
            self.refuse(404, f"no job {number}")
        else:
            self.send(found)

    def delete(self, number: str) -> None:
        """Stop it."""
        if not self.may_write:
            self.refuse(403, "this page can only look")
        else:
            self.served.jobs.stop(int(number))
            self.get(number)
