"""The scope: what a recording adds, sent as it comes.

A page that is slow or stands still is not sent more than it takes: the next look waits until the last was sent. The
recording knows nothing of it.
"""

from __future__ import annotations

import asyncio
import json
from typing import Any

from tornado.ioloop import IOLoop
from tornado.iostream import StreamClosedError
from tornado.websocket import WebSocketClosedError, WebSocketHandler

from pianorig.page.catalogue.catalogue import UnknownName
from pianorig.page.handlers.reply import Guarded
from pianorig.page.live.live_stream import LiveStream
from rig.errors import RigError

LOOKS_HZ = 30.0
LAMPS_EVERY = 6
"""Looks between two of the lamps: five times a second is as fast as an eye follows."""
GONE = 4404
"""Code of our own for a session that is not there, or no more."""


class Live(Guarded, WebSocketHandler):
    """A websocket that sends text for the state and bytes for samples."""

    _task: asyncio.Task[None] | None = None

    def check_origin(self, origin: str) -> bool:
        """The origin was checked before (`Guarded.prepare`)."""
        return True

    def open(self, *arguments: str, **more: str) -> None:
        """Begin to follow the session."""
        self._task = asyncio.get_running_loop().create_task(self._follow(arguments[0]))

    def on_message(self, message: str | bytes) -> None:
        """Nothing is taken from the page."""

    def on_close(self) -> None:
        """The page is gone."""
        if self._task is not None:
            self._task.cancel()

    async def _follow(self, name: str) -> None:
        work = IOLoop.current().run_in_executor
        try:
            stream = await work(self.served.workers, lambda: LiveStream(self.served.catalogue.folder(name)))
            looks = 0
            while True:
                state, samples = await work(self.served.workers, stream.poll)
                if state is not None:
                    await self.write_message(_text(state))
                if samples:
                    await self.write_message(samples, binary=True)
                if looks % LAMPS_EVERY == 0 and (lamps := stream.lamps()) is not None:
                    await self.write_message(_text({"lamps": lamps}))
                looks += 1
                await asyncio.sleep(1.0 / LOOKS_HZ)
        except (WebSocketClosedError, StreamClosedError):
            return
        except (RigError, UnknownName, ValueError, OSError) as error:
            self.close(GONE, " ".join(str(error).split()).encode()[:120].decode(errors="ignore"))


def _text(state: dict[str, Any]) -> str:
    return json.dumps(state)
