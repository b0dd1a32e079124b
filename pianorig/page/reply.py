"""What all answers of the page share: the checks before, the headers, failures as one line of JSON."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, NamedTuple

from tornado.ioloop import IOLoop
from tornado.iostream import StreamClosedError
from tornado.web import HTTPError, RequestHandler
from tornado.websocket import WebSocketClosedError, WebSocketHandler

from pianorig.console.output import ARGUMENT, json_text
from pianorig.console.progress import say
from pianorig.page.access import Access, Refused
from pianorig.page.catalogue import Catalogue, UnknownName
from pianorig.page.jobs import Jobs
from pianorig.page.review import FilmShelf

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


class Guarded(RequestHandler):
    """Checks a request before anything else is done with it; sets the headers."""

    served: Served

    def initialize(self, served: Served) -> None:
        """Keep what the answers are made from."""
        self.served = served

    def set_default_headers(self) -> None:
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
        self.finish(json.dumps({"error": ARGUMENT.sub(lambda found: found[1].replace("_", " "), reason)}))

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


class Sent(NamedTuple):
    """A file in place of JSON, and headers that differ from those of other answers."""

    content: bytes
    headers: dict[str, str]


class Asked(NamedTuple):
    """What a request states beside its address: values of the query, and the JSON object that was sent."""

    query: dict[str, list[str]]
    content: dict[str, Any]

    def one(self, name: str, default: str = "") -> str:
        """A value of the query, the last where there are several."""
        return [default, *self.query.get(name, ())][-1]


Work = Callable[..., Any]
"""Takes `Served`, the parts of the address and `Asked`; what it returns is sent."""


class Reply(Guarded):
    """An answer in JSON, made by a function in a thread; ``post`` and ``delete`` need ``--control``."""

    def initialize(  # type: ignore[override]
        self, served: Served, get: Work | None = None, post: Work | None = None, delete: Work | None = None
    ) -> None:
        """Keep what the answers are made from, and by."""
        super().initialize(served)
        self._work = {"get": get, "post": post, "delete": delete}

    async def get(self, *names: str) -> None:
        """Send what is asked for."""
        await self._answer("get", names, {})

    async def post(self, *names: str) -> None:
        """Do something with the JSON object that was sent."""
        content = self.body()
        if content is not None:
            await self._answer("post", names, content)

    async def delete(self, *names: str) -> None:
        """Stop something."""
        if self.let_in():
            await self._answer("delete", names, {})

    def let_in(self) -> bool:
        """Whether the page may write; False after a refusal."""
        control = self.served.access.control
        if not control:
            self.refuse(403, "this page can only look; to write, start  pianorig bench --control")
        return control

    async def _answer(self, method: str, names: Sequence[str], content: dict[str, Any]) -> None:
        """Do this address's work for ``method``, given the ``names`` in it, in a thread and send what it returns; an
        unknown name is answered by 404, an error that a user can cause by 400 and one line, another method by 405."""
        work = self._work[method]
        if work is None:
            raise HTTPError(405)
        # taken here: what is asked for depends on the address, which another thread must not read
        asked = Asked({name: self.get_query_arguments(name) for name in self.request.query_arguments}, content)
        try:
            found = await IOLoop.current().run_in_executor(
                self.served.workers, lambda: work(self.served, *names, asked)
            )
        except UnknownName as error:
            self.refuse(404, str(error))
        except Exception as error:
            if not isinstance(error, ValueError) and getattr(error, "exit_code", None) is None:
                raise
            self.refuse(400, " ".join(str(error).split()))
        else:
            self.send(found)

    def send(self, content: Any) -> None:
        """Send a `Sent` as it is, with its headers, anything else as JSON, in which a number that is not finite is
        null; ends the request."""
        if isinstance(content, Sent):
            for name, value in content.headers.items():
                self.set_header(name, value)
            self.finish(content.content)
            return
        self.set_header("Content-Type", "application/json")
        self.finish(json_text(content))

    def body(self) -> dict[str, Any] | None:
        """The JSON object of the request; None where it was refused (already answered): not allowed in, another media
        type, or no object."""
        if not self.let_in():
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


class Stream(Guarded, WebSocketHandler):
    """A websocket that tells something from the time it is opened until the page is gone."""

    _task: asyncio.Task[None] | None = None

    def check_origin(self, origin: str) -> bool:
        return True

    def open(self, *arguments: str, **more: str) -> None:
        """Begin to tell."""
        self._task = asyncio.get_running_loop().create_task(self._tell_on(*arguments))

    def on_message(self, message: str | bytes) -> Any:
        """Nothing is taken from the page."""

    def on_close(self) -> None:
        if self._task is not None:
            self._task.cancel()

    async def _tell_on(self, *arguments: str) -> None:
        with suppress(WebSocketClosedError, StreamClosedError):
            await self.tell(*arguments)

    async def tell(self, *arguments: str) -> None:
        """Write messages without end; ``arguments`` are the parts of the address."""
        raise NotImplementedError


class NotFound(Guarded):
    """Whatever has no other answer."""

    def prepare(self) -> None:
        """Refuse, after the checks."""
        super().prepare()
        if not self._finished:
            self.refuse(404, "no such page")
