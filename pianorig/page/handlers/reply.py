"""What all answers of the page share: the checks before, the headers, failures as one line of JSON."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import Any

from tornado.ioloop import IOLoop
from tornado.web import HTTPError, RequestHandler

from pianorig.console.progress import say
from pianorig.page.access import Access, Refused
from pianorig.page.catalogue.catalogue import Catalogue, UnknownName
from pianorig.page.control.plan_control import PlanControl
from pianorig.page.jobs import Jobs
from pianorig.page.review.film_shelf import FilmShelf

POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; "
    "connect-src 'self'; frame-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
"""Own scripts only; Bokeh sets styles in its elements."""
HEADERS = {
    "Content-Security-Policy": POLICY,
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cache-Control": "no-store",
    "Server": "pianorig bench",
}


@dataclass(frozen=True)
class Served:
    """What the answers are made from."""

    access: Access
    catalogue: Catalogue
    workers: Executor
    jobs: Jobs
    films: FilmShelf
    plan: PlanControl


class Guarded(RequestHandler):
    """Checks a request before anything else is done with it; sets the headers."""

    served: Served

    def initialize(self, served: Served) -> None:
        """Keep what the answers are made from."""
        self.served = served

    def set_default_headers(self) -> None:
        """Headers of every answer, also of a refusal."""
        for name, value in HEADERS.items():
            self.set_header(name, value)

    def prepare(self) -> None:
        """Refuse what does not come from this page."""
        try:
            self.served.access.check(self.request.method or "", self.request.path, self.request.headers)
        except Refused as refused:
            self.refuse(refused.status, str(refused))

    def refuse(self, status: int, reason: str) -> None:
        """End the answer with a reason in one line."""
        self.set_status(status)
        self.set_header("Content-Type", "application/json")
        self.finish(json.dumps({"error": reason}))

    def log_exception(self, *error: Any) -> None:
        """A defect is one line on the terminal, too; what is refused is told to the page only."""
        if not isinstance(error[1], HTTPError):
            say(f"bench: {self.request.path}: defect: {type(error[1]).__name__}: {error[1]}")

    def write_error(self, status_code: int, **more: Any) -> None:
        """A failure as one line of JSON, without a traceback."""
        error = (more.get("exc_info") or (None, None, None))[1]
        known = isinstance(error, HTTPError) or error is None
        reason = self._reason if known else f"defect: {type(error).__name__}: {error}"
        self.refuse(status_code, " ".join(str(reason).split()))


class Reply(Guarded):
    """An answer in JSON."""

    @property
    def may_write(self) -> bool:
        """Whether this browser was given the permission to write."""
        access = self.served.access
        return access.may_write(self.get_cookie(access.cookie_name))

    async def answer(self, work: Callable[..., Any], *arguments: Any) -> None:
        """Do some work in a thread and send what it returns; an error that a user can cause is one line."""
        try:
            found = await IOLoop.current().run_in_executor(self.served.workers, lambda: work(*arguments))
        except UnknownName as error:
            self.refuse(404, str(error))
            return
        except Exception as error:
            if not isinstance(error, ValueError) and getattr(error, "exit_code", None) is None:
                raise
            self.refuse(400, " ".join(str(error).split()))
            return
        self.send(found)

    def send(self, content: Any) -> None:
        """Send JSON; a number that is none is null."""
        self.set_header("Content-Type", "application/json")
        try:
            text = json.dumps(content, default=_plain, allow_nan=False)
        except ValueError:
            text = json.dumps(_finite(content), default=_plain)
        self.finish(text)

    def body(self) -> dict[str, Any] | None:
        """The JSON object that was sent by who may write; None after a refusal."""
        if not self.may_write:
            self.refuse(403, "this page can only look; start  pianorig bench --control  and use its address")
            return None
        if self.request.headers.get("Content-Type", "").split(";")[0] != "application/json":
            self.refuse(415, "allowed is application/json")
            return None
        try:
            content = json.loads(self.request.body)
        except (ValueError, RecursionError):
            content = None
        if not isinstance(content, dict):
            self.refuse(400, "the request is no JSON object")
            return None
        return content


class NotFound(Guarded):
    """Whatever has no other answer."""

    def prepare(self) -> None:
        """Refuse, after the checks."""
        super().prepare()
        if not self._finished:
            self.refuse(404, "no such page")


def _plain(value: Any) -> Any:
    return value.tolist() if hasattr(value, "tolist") else str(value)


def _finite(content: Any) -> Any:
    if hasattr(content, "tolist"):
        content = content.tolist()
    if isinstance(content, float):
        return content if math.isfinite(content) else None
    if isinstance(content, dict):
        return {key: _finite(value) for key, value in content.items()}
    if isinstance(content, list | tuple):
        return [_finite(value) for value in content]
    return content
