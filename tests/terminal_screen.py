"""A command run on a pseudo-terminal, and what its screen would show: the smallest emulation that counts lines."""

from __future__ import annotations

import fcntl
import os
import select
import signal
import struct
import subprocess
import sys
import termios
import time
from collections.abc import Callable, Mapping
from pathlib import Path


class Screen:
    """Lines of a terminal of some width; a character beyond the last column starts a new line, as it does there."""

    def __init__(self, columns: int) -> None:
        self.columns = columns
        self.lines = [""]
        self.wrapped = 0
        self.returns = 0
        self._at = 0

    def feed(self, text: str) -> None:
        """Take printed text; a control character but carriage return and line feed is refused."""
        for sign in text:
            if sign == "\r":
                self._at, self.returns = 0, self.returns + 1
            elif sign == "\n":
                self.lines.append("")
                self._at = 0
            else:
                assert sign.isprintable(), f"control character {sign!r} after {self.lines[-1]!r}"
                if self._at == self.columns:
                    self.lines.append("")
                    self.wrapped, self._at = self.wrapped + 1, 0
                line = self.lines[-1].ljust(self._at)
                self.lines[-1] = line[: self._at] + sign + line[self._at + 1 :]
                self._at += 1

    def shown(self) -> list[str]:
        """Lines that are not empty."""
        return [line.rstrip() for line in self.lines if line.strip()]


class OnTerminal:
    """``python -m pianorig …`` on a pseudo-terminal; standard output is a pipe, so that progress is seen alone."""

    def __init__(self, *words: str | Path, columns: int, cwd: Path, env: Mapping[str, str] | None = None) -> None:
        master, slave = os.openpty()
        fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", 24, columns, 0, 0))
        environment = {name: value for name, value in os.environ.items() if name != "COLUMNS"} | dict(env or {})
        # tests started in the background of a script ignore Ctrl-C, and the command would inherit that
        before = signal.signal(signal.SIGINT, signal.default_int_handler)
        self.process = subprocess.Popen(
            [sys.executable, "-m", "pianorig", *map(str, words)],
            stdin=slave, stdout=subprocess.PIPE, stderr=slave, cwd=cwd, env=environment, start_new_session=True,
        )  # fmt: skip
        signal.signal(signal.SIGINT, before)
        os.close(slave)
        self._master = master
        self.screen = Screen(columns)
        self.output = ""

    def run(self, interrupt: Callable[[str], bool] = lambda text: False, timeout_s: float = 240.0) -> str:
        """Read to the end, sending Ctrl-C once when ``interrupt`` of all the text says so; return that text."""
        text, end_s, sent = "", time.monotonic() + timeout_s, False
        raw = bytearray()
        while True:
            assert time.monotonic() < end_s, f"still running after {timeout_s} s: {text[-300:]!r}"
            if not select.select([self._master], [], [], 0.2)[0]:
                if self.process.poll() is not None:
                    break
                continue
            try:
                data = os.read(self._master, 65536)
            except OSError:  # the last process has closed its end
                break
            if not data:
                break
            raw += data
            text = raw.decode("utf-8", errors="replace")
            if not sent and interrupt(text):
                sent = True
                self.process.send_signal(signal.SIGINT)
        assert self.process.stdout is not None
        with self.process.stdout:
            self.output = self.process.stdout.read().decode()
        self.process.wait(30)
        os.close(self._master)
        self.screen.feed(raw.decode("utf-8"))
        return text
