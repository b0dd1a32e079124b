"""What a damaged entry of a kernel cache does: no crash, the same numbers, one warning, and the next run is quiet.

    python -m benchmarks damaged_cache [--damages 200] [--results FILE --minutes M]

Each case copies a warm cache, damages one entry at a place drawn by lot and runs a process twice: ``simulate`` of the
forte blow (the scene's machine code and numba's entries of the step loop), or the prefilter of `vision` (numba's). An
entry of what another function calls is read only where that function is not found, so all others are removed for it.
Two processes also start at once on a damaged cache. Wrong is any exit code but 0, any other number, a first run that
does not name the entry in exactly one warning, and a second run that warns.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from collections import defaultdict
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

import model
from benchmarks.runner import ROOT, Run, Table

PREFILTER = """
import hashlib, sys, warnings
import numpy as np
warnings.showwarning = lambda message, *_: print(f"warning: {message}", file=sys.stderr)
from vision.fitting.frame_spline import prefilter
picture = np.random.default_rng(4).integers(0, 256, (40, 60)).astype(np.uint8)
out = np.zeros((40, 60), dtype=np.float32)
print(prefilter(picture, out), hashlib.sha256(out.tobytes()).hexdigest())
"""
OUTERMOST = ("scene_", "rosenbrock.integrate-", "frame_spline.prefilter-")
"""Entries that are read at every run."""
BITS = 3
"""Of five damages, so many flip a single bit."""


def _flip(data: bytearray, draw: np.random.Generator) -> bytes:
    data[int(draw.integers(len(data)))] ^= 1 << int(draw.integers(8))
    return bytes(data)


def _overwrite(data: bytearray, draw: np.random.Generator, content: bytes) -> bytes:
    at = int(draw.integers(max(len(data) - len(content), 1)))
    data[at : at + len(content)] = content
    return bytes(data)


KINDS: dict[str, Callable[[bytearray, np.random.Generator], bytes]] = {
    "bit": _flip,
    "empty": lambda data, draw: b"",
    "half": lambda data, draw: bytes(data[: len(data) // 2]),
    "100 bytes less": lambda data, draw: bytes(data[:-100]),
    "cut anywhere": lambda data, draw: bytes(data[: int(draw.integers(len(data)))]),
    "garbage head": lambda data, draw: draw.bytes(16) + bytes(data[16:]),
    "64 zeros": lambda data, draw: _overwrite(data, draw, bytes(64)),
    "64 random bytes": lambda data, draw: _overwrite(data, draw, draw.bytes(64)),
    "all zeros": lambda data, draw: bytes(len(data)),
}


def entries(cache: Path) -> list[Path]:
    """Entries of a kernel cache."""
    return sorted(path for path in cache.rglob("*") if path.suffix in (".o", ".nbi", ".nbc"))


def function_of(entry: Path) -> str:
    """What an entry of numba's belongs to; an index and its code to the same."""
    return entry.name.partition(".numba")[0]


def write_force(folder: Path) -> None:
    """Write the force of the forte as a file."""
    table = np.column_stack(model.force_table("forte"))
    np.savetxt(folder / "force.csv", table, delimiter=",", header="time_s,force_n", comments="")


def called(job: str, folder: Path) -> tuple[int, str, list[str]]:
    """Exit code of a job on the cache in ``folder``, its numbers, and its warnings."""
    caches = {"PIANORIG_CACHE_DIR": str(folder / "cache"), "NUMBA_CACHE_DIR": str(folder / "cache")}
    out = folder / "out.csv"
    command = {
        "simulate": ["-m", "pianorig", "simulate", "--force", str(folder / "force.csv"), "--out", str(out)],
        "prefilter": ["-c", PREFILTER],
    }[job]
    out.unlink(missing_ok=True)
    done = subprocess.run(
        [sys.executable, "-P", *command], env=os.environ | {"PYTHONPATH": str(ROOT)} | caches, cwd=folder,
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    numbers = done.stdout if job == "prefilter" else (out.read_text("utf-8") if out.is_file() else "")
    warned = [line for line in done.stderr.splitlines() if line.startswith("warning:")]
    return done.returncode, numbers, warned


class Warm:
    """A warm cache for each job, with the numbers that it gives; made when first asked for."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._numbers: dict[str, str] = {}

    def made(self, job: str) -> tuple[Path, str]:
        """Folder with the cache of a job, and its numbers."""
        folder = self.folder / job
        if job not in self._numbers:
            folder.mkdir()
            write_force(folder)
            code, numbers, _ = called(job, folder)
            again = called(job, folder)
            if code or again != (0, numbers, []):
                raise SystemExit(f"{job}: fails on a whole cache: {again}")
            self._numbers[job] = numbers
        return folder, self._numbers[job]

    def damage(self, number: int, job: str, kind: str) -> dict[str, Any]:
        """Damage one entry of a copy of the cache; what the next two runs do."""
        folder, numbers = self.made(job)
        draw = np.random.default_rng([48, number])
        with tempfile.TemporaryDirectory() as place:
            copy = Path(place) / job
            shutil.copytree(folder, copy)
            there = entries(copy / "cache")
            entry = there[int(draw.integers(len(there)))]
            if not entry.name.startswith(OUTERMOST):
                for other in there:
                    if function_of(other) != function_of(entry):
                        other.unlink()
            entry.write_bytes(KINDS[kind](bytearray(entry.read_bytes()), draw))
            first, second = called(job, copy), called(job, copy)
        return {
            "entry": entry.name,
            "codes": [first[0], second[0]],
            "same": [first[1] == numbers, second[1] == numbers],
            "named": len(first[2]) == 1 and entry.name in first[2][0],
            "quiet": not second[2],
        }

    def two_at_once(self) -> bool:
        """Whether two processes that start together on a damaged cache are right and leave a whole one."""
        folder, numbers = self.made("simulate")
        with tempfile.TemporaryDirectory() as place:
            copy = Path(place) / "first"
            shutil.copytree(folder, copy)
            for entry in entries(copy / "cache"):
                entry.write_bytes(entry.read_bytes()[:-1])
            beside = Path(place) / "second"
            beside.mkdir()
            write_force(beside)
            (beside / "cache").symlink_to(copy / "cache")
            with ThreadPoolExecutor(2) as pool:
                done = list(pool.map(lambda where: called("simulate", where), (copy, beside)))
            done.append(called("simulate", beside))
        return all(code == 0 and found == numbers for code, found, _ in done) and not done[-1][2]


def main(run: Run) -> bool:
    """Print a row for each kind of damage; whether none had an effect beyond its warning."""
    others = [kind for kind in KINDS if kind != "bit"]
    keys = []
    for number in range(run.damages):
        kind = "bit" if number % 5 < BITS else others[(number // 5 * 2 + number % 5) % len(others)]
        keys.append((number, "prefilter" if number % 4 == 3 else "simulate", kind))
    with tempfile.TemporaryDirectory() as place:
        warm = Warm(Path(place))
        rows: defaultdict[tuple[str, str], list[dict[str, Any]]] = defaultdict(list)
        for (_, job, kind), found in run.cases(keys, warm.damage):
            rows[job, kind].append(found)
        at_once = warm.two_at_once()
    table = Table(
        "job:9s", "damage:15s", "cases:d", "not exit 0:d", "other numbers:d", "not named once:d", "next run warns:d"
    )
    wrong = 0
    for (job, kind), found in sorted(rows.items()):
        counts = [
            sum(any(one["codes"]) for one in found),
            sum(not all(one["same"]) for one in found),
            sum(not one["named"] for one in found),
            sum(not one["quiet"] for one in found),
        ]
        table.row(job, kind, len(found), *counts)
        wrong += sum(counts)
    print(f"{sum(map(len, rows.values()))} damages, {wrong} wrong; two at once: {'right' if at_once else 'WRONG'}")
    return wrong == 0 and at_once
