"""How long a user waits: every command of the README, in the README's order, each in a process of its own.

A turn runs all commands in a fresh folder, so that no result of these trials is kept; kernels are compiled already, and
with ``--cold`` each command finds an empty kernel cache. Python's bytecode is there, as an installation leaves it. With
``--against`` two checkouts take turns. Columns: wall and processor time, peak memory, and the processor time split into
importing, compiling, drawing, writing and the rest (computing), each without what it calls of another; the least of all
turns. Right: no command takes over 10 s by the clock, warm (`identify` 40 s), nor over 1.05 of the processor time of
the other checkout.
"""

from __future__ import annotations

import functools
import json
import os
import shlex
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from benchmarks.runner import Checkout, Run

PARTS = ("import", "compile", "draw", "write")
TIMED = {
    "model.codegen.load": (("link_kernels", "compile"),),
    "matplotlib.backends.backend_agg": (("FigureCanvasAgg.print_png", "draw"),),
    "validation.report.page": (("render_html", "draw"),),
    "validation.report.write": (("write_side_by_side", "write"),),
    "pianorig.console.column_file": (("write_columns", "write"),),
    "rig.session.sealed_trial": (("write_trial", "write"),),
}
PACKAGES = ("model", "vision", "rig", "validation", "pianorig")
WAITING = ("bench", "open")  # for somebody
SESSIONS = ("planted_faults", "kawai_kg3c")
LONGEST_S, LONGEST_FIT_S, SLOWER = 10.0, 40.0, 1.05


def main(run: Run) -> bool:
    """Print the table of this checkout and, with ``--against``, the ratio to the other one."""
    from benchmarks.runner import ROOT, Checkout, Table  # start-up: the child process times what it imports

    every = {"this": Checkout(ROOT)} | ({"other": Checkout(run.against)} if run.against else {})
    lines = [words for words in commands((ROOT / "README.md").read_text(encoding="utf-8")) if run.only in words[0]]
    found: dict[tuple[str, int], list[dict[str, float]]] = {}
    with tempfile.TemporaryDirectory() as bytecode:
        installed = {
            name: {"PYTHONDONTWRITEBYTECODE": "", "PYTHONPYCACHEPREFIX": f"{bytecode}/{name}"} for name in every
        }
        for name, checkout in every.items():
            packages = [checkout.root / package for package in PACKAGES]
            checkout.run("-m", "compileall", "-q", *packages, **installed[name])
        for _, (name, checkout) in product(range(run.turns), every.items()):
            with tempfile.TemporaryDirectory() as folder:
                for i, spent in enumerate(turn(checkout, lines, Path(folder), run.cold, installed[name])):
                    found.setdefault((name, i), []).extend([spent] if spent else [])
    parts = (*PARTS, "compute")
    table = Table("command:<34", "wall s:6.2f", "cpu s:6.2f", "MB:5.0f", *(f"{p}:7.2f" for p in parts), "of other:8.2f")
    good = True
    for i, words in enumerate(lines):
        least = {
            name: {key: min(one[key] for one in rows) for key in rows[0]}
            for (name, j), rows in found.items()
            if j == i and rows
        }
        own = least.get("this")
        ratio = own["cpu"] / least["other"]["cpu"] if own and "other" in least else None
        limit = LONGEST_FIT_S if words[0] == "identify" else LONGEST_S
        good &= own is not None and (run.cold or own["wall"] <= limit) and (ratio is None or ratio <= SLOWER)
        shown = [own[key] for key in ("wall", "cpu", "memory", *parts)] if own else [None] * 8
        table.row(" ".join(words)[:34], *shown, ratio)
    return good


def commands(text: str) -> Iterator[list[str]]:
    """Words of each command of the README's blocks, and of its demo."""
    yield ["demo", "--out", "demo"]
    for block in text.split("```sh\n")[1:]:
        for line in block.partition("```")[0].splitlines():
            words = shlex.split(line)
            if words[:1] == ["pianorig"] and words[1] not in WAITING:
                yield words[1:]


def turn(
    checkout: Checkout, lines: list[list[str]], folder: Path, cold: bool, installed: dict[str, str]
) -> Iterator[dict[str, float] | None]:
    """What each command took, one after the other in the folder; None of one that this checkout refuses."""
    for name in SESSIONS:
        kept = shutil.ignore_patterns("derived", "report*") if name == "kawai_kg3c" else None
        shutil.copytree(checkout.root / "sessions" / name, folder / "sessions" / name, ignore=kept)
    for words in lines:
        place = folder / "spent.json"
        place.unlink(missing_ok=True)
        cache = installed | ({"PIANORIG_CACHE_DIR": str(folder / "empty" / words[0])} if cold else {})
        began = time.perf_counter()
        try:
            checkout.run(__file__, place, folder, *words, OPENBLAS_NUM_THREADS="1", **cache)
        except SystemExit as failure:
            print(failure, file=sys.stderr)
        wall = time.perf_counter() - began
        yield json.loads(place.read_text(encoding="utf-8")) | {"wall": wall} if place.is_file() else None


class Clock:
    """Processor time of each part of this process, without the parts inside it."""

    def __init__(self) -> None:
        self.spent = dict.fromkeys(PARTS, 0.0)
        self.open: list[list[Any]] = []  # part and when it went on

    def timed(self, part: str, work: Callable[..., Any]) -> Callable[..., Any]:
        """The same function, timed as this part."""

        @functools.wraps(work)
        def call(*given: Any, **named: Any) -> Any:
            now = time.process_time()
            if self.open:
                self.spent[self.open[-1][0]] += now - self.open[-1][1]
            self.open.append([part, now])
            try:
                return work(*given, **named)
            finally:
                now, (_, began) = time.process_time(), self.open.pop()
                self.spent[part] += now - began
                if self.open:
                    self.open[-1][1] = now

        return call


def child(place: str, folder: str, *words: str) -> None:
    """Run one command in this process and write what it took."""
    import importlib._bootstrap as bootstrap  # type: ignore[import-not-found]

    clock, load = Clock(), bootstrap._find_and_load

    def find_and_load(name: str, finder: Any) -> Any:
        module = clock.timed("import", load)(name, finder)
        for path, part in TIMED.get(name, ()):
            *above, last = path.split(".")
            holder = getattr(module, above[0]) if above else module
            if not hasattr(getattr(holder, last), "timed_as"):
                setattr(holder, last, clock.timed(part, getattr(holder, last)))
                getattr(holder, last).timed_as = part
        return module

    bootstrap._find_and_load = find_and_load
    os.chdir(folder)
    from pianorig.cli import main as command

    code: Any = 1
    try:
        command(list(words))
    except SystemExit as stop:
        code = stop.code
    if code:
        sys.exit(code)
    cpu = sum(os.times()[:4])
    import resource

    memory = max(resource.getrusage(who).ru_maxrss for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)) / 1024
    rest = cpu - sum(clock.spent.values())
    Path(place).write_text(json.dumps({"cpu": cpu, "memory": memory, "compute": rest, **clock.spent}), encoding="utf-8")


if __name__ == "__main__":
    child(*sys.argv[1:])
