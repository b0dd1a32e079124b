"""A Python program in another process."""

from __future__ import annotations

import json
import queue
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from typing import Any

DEADLINE_S = 180.0
"""Where something hangs; on a busy machine a process that loads the model may take a minute to begin."""
END = "end\n"


class Program:
    """The program and its lines as they come, ``end`` behind the last."""

    def __init__(self, *arguments: str, **more: Any) -> None:
        self.process = subprocess.Popen(
            [sys.executable, *arguments],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            creationflags=getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0),
            **more,
        )
        assert self.process.stdin is not None and self.process.stdout is not None
        self.said, self._heard = self.process.stdin, self.process.stdout
        self.lines: queue.Queue[str] = queue.Queue()
        self._pump = threading.Thread(target=self._take, daemon=True)
        self._pump.start()

    def _take(self) -> None:
        for line in self._heard:
            self.lines.put(line)
        self.lines.put(END)

    def wait_for(self, wanted: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
        """Return the first JSON line that is wanted."""
        end = time.monotonic() + DEADLINE_S
        while True:
            found = json.loads(self.lines.get(timeout=max(end - time.monotonic(), 0.0)))
            if wanted(found):
                return found

    def end(self, number: int | None = signal.SIGTERM) -> int:
        """End it, by a signal or by the end of its input, and return its exit code."""
        if number is not None and self.process.poll() is None:
            self.process.send_signal(number)
        self.said.close()
        code = self.process.wait(DEADLINE_S)
        self._pump.join(DEADLINE_S)
        self._heard.close()
        return code
