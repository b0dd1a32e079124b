"""The ``pianorig`` commands in a document's ``sh`` blocks, run as they stand in a folder of examples.

A command for hardware must end in one line that names what does not answer; then it is run without ``--backend``, on
the virtual bench, as the pages say it can be rehearsed.
"""

from __future__ import annotations

import re
import shlex
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

HARDWARE = re.compile(r"\bni(-grpc)?://")
OUTPUTS = {"--out", "--figure", "--animation", "--contact-sheet", "--overlay", "--propose-bodies", "--curve"}
FILE = re.compile(r"\.(csv|toml|mraw|h5|cihx)$")
SERVERS = {"serve-sim": "virtual", "bench": "stop with Ctrl-C"}
"""Commands that run until Ctrl-C, and a word of what they say at first."""
QUICK = {"annotate", "attach", "calibrate-camera", "import", "info", "open", "recover", "simulate", "track", "watch"}
"""Commands that take seconds once the kernels are compiled, as far as their files are there."""


def commands_of(text: str) -> Iterator[list[str]]:
    """The words of every command, in the order of the document, without ``pianorig``."""
    for block in re.findall(r"^ *```sh\n(.*?)^ *```", text, re.MULTILINE | re.DOTALL):
        for line in block.replace("\\\n", " ").splitlines():
            for part in line.strip().split("&&"):
                words = shlex.split(part, comments=True)
                if words[:1] == ["pianorig"]:
                    yield words[1:]


def is_quick(words: list[str], folder: Path) -> bool:
    """Whether a command takes seconds, and needs no file that a longer one would make first."""
    drawn = {"--animation", "--figure"} & set(words)
    if words[0] not in QUICK or drawn or any(HARDWARE.search(word) for word in words):
        return False
    pairs = zip([""] + words[:-1], words, strict=True)
    if words[0] == "open":
        return len(words) > 1 and (folder / words[1] / "report.html").exists()
    needed = [w for before, w in pairs if before not in OUTPUTS and (FILE.search(w) or w.startswith("sessions/"))]
    return all((folder / name).exists() for name in needed)


def run_documented(words: list[str], folder: Path, timeout_s: float = 600.0) -> str:
    """Run one command and check how it ends; what asks for hardware is refused in one line, a server is stopped."""
    line = [sys.executable, "-m", "pianorig", *words]
    if words[0] == "open":
        line.append("--no-show")
    if words[0] in SERVERS:
        return _serve([*line, *(["--no-show"] if words[0] == "bench" else [])], folder, SERVERS[words[0]])
    done = subprocess.run(line, cwd=folder, capture_output=True, timeout=timeout_s, stdin=subprocess.DEVNULL)
    said = done.stdout.decode("utf-8") + done.stderr.decode("utf-8")
    if any(HARDWARE.search(word) for word in words):
        assert done.returncode == 3 and len(done.stderr.splitlines()) <= 2, (words, said)
        return said + (run_documented(rehearsal(words), folder) if "--backend" in words else "")
    assert done.returncode == 0, (words, said)
    return said


def rehearsal(words: list[str]) -> list[str]:
    """A command without ``--backend``: on the virtual bench."""
    at = words.index("--backend")
    instead = ["--backend", "sim://"] if words[0] == "info" else []  # without an address it names no devices
    return words[:at] + instead + words[at + 2 :]


def _serve(line: list[str], folder: Path, word: str) -> str:
    server = subprocess.Popen(line, cwd=folder, stdout=subprocess.PIPE, text=True)
    assert server.stdout is not None
    with server.stdout:
        said = server.stdout.readline()
        time.sleep(1.0)  # it serves a moment after it has said so
        server.send_signal(signal.SIGINT)
        assert server.wait(60) == 0, line
    assert word in said
    return said
