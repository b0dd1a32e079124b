"""Event streams of all clients of a server, sent from one thread, so that no stream occupies a worker."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any

from rig.simulated.rpc.event_streams import POLL_S, EventStream

BUSY = 0.25
"""Part of the time that looking at the streams may take: with many of them each is looked at less often."""


class StreamPump:
    """The streams of a server; its thread begins with the first one."""

    def __init__(self) -> None:
        self._streams: dict[EventStream, Callable[[Any], None]] = {}
        self._changed = threading.Condition()
        self._thread: threading.Thread | None = None

    def add(self, stream: EventStream, send: Callable[[Any], None]) -> None:
        """Send a stream's responses with ``send`` as they come, and None after the last."""
        with self._changed:
            self._streams[stream] = send
            if self._thread is None:
                self._thread = threading.Thread(target=self._run, name="event streams", daemon=True)
                self._thread.start()
            self._changed.notify()

    def remove(self, stream: EventStream) -> None:
        """End a stream whose client is gone, or that has ended."""
        stream.cancel()
        with self._changed:
            self._streams.pop(stream, None)

    def _run(self) -> None:
        while True:
            with self._changed:
                while not self._streams:
                    self._changed.wait()
                streams = list(self._streams.items())
            began = time.perf_counter()
            for stream, send in streams:
                if not stream.waits:
                    self._serve(stream, send)
            time.sleep(max(POLL_S, (time.perf_counter() - began) * (1 / BUSY - 1)))

    def _serve(self, stream: EventStream, send: Callable[[Any], None]) -> None:
        answer, ended = stream.poll()
        while answer is not None:
            send(answer)
            if ended:
                break
            answer, ended = stream.poll()
        if ended:
            self.remove(stream)
            send(None)
