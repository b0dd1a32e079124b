"""The server of the page: on the loopback, one process, until Ctrl-C."""

from __future__ import annotations

import asyncio
import errno
import signal
import socket
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tornado.httpserver import HTTPServer
from tornado.web import Application

from pianorig.errors import CommandInputError
from pianorig.page.access import LOOPBACK, Access
from pianorig.page.answers import drawing_scripts, routes
from pianorig.page.catalogue import Catalogue
from pianorig.page.jobs import Jobs
from pianorig.page.reply import NotFound, Served
from pianorig.page.review import FilmShelf

LARGEST_REQUEST_BYTES = 1_000_000  # 32 outlines of 500 points are 0.4 MB
WORKERS = 4  # threads: choice; a browser asks six things at once


@dataclass(frozen=True)
class BenchOptions:
    """What the page shows and where.

    Attributes
    ----------
    folder : of the sessions
    port : TCP port; 0 takes a free one
    control : let the page write
    """

    folder: Path
    port: int = 0
    control: bool = False


class BenchServer:
    """The page, listening; ends with `close`."""

    def __init__(self, options: BenchOptions) -> None:
        scripts = drawing_scripts()
        catalogue = Catalogue(options.folder)
        try:
            listening = socket.create_server((LOOPBACK, options.port))
        except OSError as error:
            busy = error.errno == errno.EADDRINUSE
            raise CommandInputError(
                f"--port {options.port}: {'is in use' if busy else error.strerror}; choose another, or 0 for a free one"
            ) from error
        listening.setblocking(False)
        self.access = Access(listening.getsockname()[1], options.control)
        self._workers = ThreadPoolExecutor(WORKERS, thread_name_prefix="bench page")
        self._jobs = Jobs()
        self._films = FilmShelf()
        served = Served(self.access, catalogue, self._workers, self._jobs, self._films)
        page = Application(
            routes(served, scripts),
            default_handler_class=NotFound,
            default_handler_args={"served": served},
            log_function=_silent,
        )
        self._server = HTTPServer(page, max_body_size=LARGEST_REQUEST_BYTES)
        self._server.add_socket(listening)

    async def close(self) -> None:
        """Stop listening, end jobs, close what browsers keep open."""
        self._server.stop()
        self._jobs.close()
        await self._server.close_all_connections()
        self._workers.shutdown(cancel_futures=True)
        self._films.close()


def _silent(handler: Any) -> None:
    """Requests are not told on the terminal; an error is told to the page that caused it."""


def serve_until_interrupted(options: BenchOptions, announce: Callable[[Access], None]) -> None:
    """Serve the page until Ctrl-C or SIGTERM; ``announce`` is called once with its address when it listens;
    CommandInputError where folder or port cannot be used."""

    async def serve() -> None:
        ended = asyncio.Event()
        loop = asyncio.get_running_loop()
        for number in (signal.SIGINT, signal.SIGTERM):
            with suppress(NotImplementedError):  # Windows: Ctrl-C arrives as KeyboardInterrupt
                loop.add_signal_handler(number, ended.set)
        server = BenchServer(options)
        try:
            announce(server.access)
            await ended.wait()
        finally:
            await server.close()

    asyncio.run(serve())
