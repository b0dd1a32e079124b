"""One runner of all benchmarks, and what they share: options, resuming, times in turns, two checkouts, tables.

    python -m benchmarks                                     # all benchmarks and their claims
    python -m benchmarks NAME [--quick] [OPTIONS]            # one, in full size or small; --help lists its options
    python -m benchmarks NAME --results FILE --minutes M     # a case is a line of FILE; the same again goes on
    python -m benchmarks NAME --against CHECKOUT             # also with the packages of another checkout
    python -m benchmarks figures                             # write docs/figures.md (`benchmarks.figures`)
    python -m benchmarks all --minutes M                     # measure again each figure that is older than its code

``registry.toml`` names each benchmark's claim, the code that it measures, its full size (which are its options) and its
quick one. A benchmark is a module with ``main(run)``, or a function of its name in the module that the registry names;
what it returns is whether its answers are right, or nothing.
Exit code 0: right; 1: a claim or an answer is wrong; 3: cases are left to run.
"""

from __future__ import annotations

import argparse
import importlib
import inspect
import json
import multiprocessing
import os
import subprocess
import sys
import tempfile
import time
import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from benchmarks import figures

ROOT = Path(__file__).resolve().parents[1]
REGISTRY = Path(__file__).with_name("registry.toml")
LEFT = 3
"""Exit code where cases are left to run."""
CHUNK = 4
Key = tuple[Any, ...]


class Run(argparse.Namespace):
    """The options of one run by name, and what is resumed and stored of it.

    Attributes
    ----------
    benchmark : its name
    quick : whether the quick size was asked for
    results : file of cases, a JSON line each; None: nothing is kept
    minutes : no case is started later than this
    against : another checkout, or None
    rest : arguments after ``--``
    left : cases that there was no time for
    """

    def __init__(self, **options: Any) -> None:
        super().__init__(**{"results": None, "minutes": np.inf, "against": None, "left": 0, "figures": {}, **options})
        self.began = time.monotonic()

    def cases(self, keys: Iterable[Key], work: Callable[..., Any], workers: int = 1) -> Iterator[tuple[Key, Any]]:
        """Yield every key with ``work(*key)``, as plain data; what ``results`` holds is not computed again.

        Parameters
        ----------
        keys : of plain values; a key holds all that its outcome depends on
        work : a function of a key's values that returns plain data; of a module where there are ``workers``
        workers : processes
        """
        kept: dict[str, Any] = {}
        if self.results is not None and self.results.is_file():
            for line in self.results.read_text(encoding="utf-8").splitlines():
                row = json.loads(line)
                kept[json.dumps(row["case"])] = row["outcome"]
        asked = [(key, json.dumps([self.benchmark, *key])) for key in keys]
        missing = [(key, mark) for key, mark in asked if mark not in kept]
        made = self._made([key for key, _ in missing], work, workers)
        for key, mark in asked:
            if mark not in kept:
                outcome = next(made, None)
                if outcome is None:
                    self.left += 1
                    continue
                line = json.dumps(outcome)
                kept[mark] = json.loads(line)  # as it is read from the file another time
                if self.results is not None:
                    with self.results.open("a", encoding="utf-8") as sheet:
                        sheet.write(f'{{"case": {mark}, "outcome": {line}}}\n')
            yield key, kept[mark]

    def _made(self, keys: Sequence[Key], work: Callable[..., Any], workers: int) -> Iterator[Any]:
        def in_time() -> bool:
            return time.monotonic() - self.began < 60.0 * self.minutes

        if workers == 1:
            yield from (work(*key) for key in keys if in_time())
            return
        with ProcessPoolExecutor(workers, multiprocessing.get_context("spawn")) as pool:
            for first in range(0, len(keys), CHUNK * workers):
                if in_time():
                    yield from pool.map(work, *zip(*keys[first : first + CHUNK * workers], strict=True))

    def figure(self, row: str, text: str) -> None:
        """A figure of a row of docs/figures.md, stored with ``--write``."""
        self.figures[row] = text
        print(f"figure of {row}: {text}", flush=True)


class Table:
    """Print rows one by one below their heads; a column is ``"head:format"``, None and NaN are printed as a dash."""

    def __init__(self, *columns: str) -> None:
        self.heads, self.formats = zip(*(column.rpartition(":")[::2] for column in columns), strict=True)
        self.widths = []
        for head, form in zip(self.heads, self.formats, strict=True):
            width = "".join(c for c in form.partition(".")[0].lstrip("<>+") if c.isdigit())
            self.widths.append(max(len(head), int(width or 0)))
        self.sides = ["<" if form.startswith("<") or form.endswith("s") else ">" for form in self.formats]
        self._line(self.heads)

    def _line(self, cells: Iterable[str]) -> None:
        sides = zip(cells, self.sides, self.widths, strict=True)
        print("  ".join(f"{cell:{side}{width}}" for cell, side, width in sides).rstrip(), flush=True)

    def row(self, *values: Any) -> None:
        """Print a row."""
        empty = [v is None or (isinstance(v, float) and np.isnan(v)) for v in values]
        cells = zip(values, self.formats, empty, strict=True)
        self._line("-" if none else format(value, form) for value, form, none in cells)


def interval(hits: int, of: int, level: float = 0.95) -> tuple[float, float]:
    """Two-sided interval of a rate by Clopper and Pearson, Biometrika 26 (1934) 404."""
    found = stats.binomtest(int(hits), max(int(of), 1)).proportion_ci(level, "exact")
    return float(found.low), float(found.high)


def at_most(hits: int, of: int, level: float = 0.95) -> float:
    """One-sided upper limit of a rate, as `interval`."""
    return float(stats.beta.ppf(level, hits + 1, of - hits)) if of > hits else 1.0


def may_be(share: float, hits: int, of: int) -> bool:
    """Whether a rate of at least ``share`` is not excluded by these hits: below the upper end of the 99 % interval."""
    return interval(hits, of, 0.99)[1] >= share


def in_turns(
    jobs: Mapping[Any, Callable[[], object]], turns: int, clock: Callable[[], float] = time.process_time
) -> dict[Any, NDArray[np.float64]]:
    """Seconds (turns,) of each job, all jobs in turns after one uncounted turn, so that other load meets all alike."""
    spent: dict[Any, list[float]] = {name: [] for name in jobs}
    for _ in range(turns + 1):
        for name, work in jobs.items():
            began = clock()
            work()
            spent[name].append(clock() - began)
    return {name: np.array(seconds[1:]) for name, seconds in spent.items()}


def least(work: Callable[[], object], turns: int = 2, clock: Callable[[], float] = time.process_time) -> float:
    """Least seconds of some repetitions after an uncounted one."""
    return float(in_turns({"": work}, turns, clock)[""].min())


class Checkout(NamedTuple):
    """A source tree, run by this interpreter."""

    root: Path

    def run(self, *arguments: str | Path, **variables: str) -> tuple[float, float, str]:
        """Wall and processor time (s) of a Python process on this source, and what it printed.

        Raises
        ------
        SystemExit
            With what the process said, where it fails.
        """
        environment = os.environ | {"PYTHONPATH": str(self.root)} | variables
        before, began = os.times(), time.perf_counter()
        done = subprocess.run(
            [sys.executable, "-P", *map(str, arguments)],
            env=environment, cwd=tempfile.gettempdir(), capture_output=True, text=True, check=False,
        )  # fmt: skip
        wall, after = time.perf_counter() - began, os.times()
        if done.returncode:
            raise SystemExit(f"{self.root}: {arguments[:6]}: exit {done.returncode}\n{done.stderr}")
        spent = after.children_user + after.children_system - before.children_user - before.children_system
        return wall, spent, done.stdout


def checkouts(run: Run) -> tuple[Checkout, Checkout]:
    """The other checkout and this one.

    Raises
    ------
    SystemExit
        Without ``--against``.
    """
    if run.against is None:
        raise SystemExit(f"{run.benchmark}: --against CHECKOUT is missing: the checkout to compare this one with")
    return Checkout(run.against), Checkout(ROOT)


def with_packages_of(checkout: Path, arguments: Sequence[str]) -> int:
    """Run this checkout's benchmark on its own packages, then on those of another; the worse exit code."""
    codes = []
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "benchmarks").symlink_to(ROOT / "benchmarks")
        for root in (ROOT, checkout):
            print(f"--- packages of {root}", flush=True)
            environment = os.environ | {"PYTHONPATH": os.pathsep.join((folder, str(root)))}
            command = [sys.executable, "-P", "-m", "benchmarks", *arguments]
            codes.append(subprocess.run(command, env=environment, check=False).returncode)
    return max(codes)


def registry() -> dict[str, dict[str, Any]]:
    """Every benchmark by its name: claim, measures, full and quick size."""
    entries = tomllib.loads(REGISTRY.read_text(encoding="utf-8"))
    code = entries.pop("code")
    for entry in entries.values():
        entry["measures"] = [path for name in entry["measures"] for path in code.get(name, [name])]
    return entries


def word(text: str) -> int | str:
    """A whole number, or else the text itself."""
    return int(text) if text.isdigit() else text


def parser(name: str, entry: Mapping[str, Any], description: str) -> argparse.ArgumentParser:
    """The options of a benchmark, those of all and its own."""
    out = argparse.ArgumentParser(
        prog=f"python -m benchmarks {name}", description=description,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )  # fmt: skip
    out.add_argument("--quick", action="store_true", help="small: the way is tried, the claim is not")
    out.add_argument("--against", type=Path, metavar="CHECKOUT", help="also with the packages of this checkout")
    out.add_argument("--results", type=Path, metavar="FILE", help="cases done, a JSON line each; goes on there")
    out.add_argument("--minutes", type=float, default=np.inf, help="start no case after this time")
    out.add_argument("--write", action="store_true", help="store the figures that the run makes, for docs/figures.md")
    for option, value in entry["full"].items():
        flag = f"--{option.replace('_', '-')}"
        if isinstance(value, bool):
            out.add_argument(flag, action="store_true")
        elif isinstance(value, list):
            kind = type(value[0]) if value else word
            out.add_argument(
                flag, default=value, type=lambda text, kind=kind: [kind(part) for part in text.split(",") if part],
                help=f"separated by commas (default: {','.join(map(str, value))})".replace("%", "%%"),
            )  # fmt: skip
        else:
            out.add_argument(flag, default=value, type=type(value), help=f"(default: {value})")
    return out


def parsed(name: str, arguments: Sequence[str], description: str = "") -> Run:
    """The run that these arguments ask for."""
    entry = registry()[name]
    own, rest = list(arguments), []
    if "--" in own:
        own, rest = own[: own.index("--")], own[own.index("--") + 1 :]
    options = parser(name, entry, description)
    if "--quick" in own:
        options.set_defaults(**entry.get("quick", {}))
    run = options.parse_args(own, Run(benchmark=name, rest=rest))
    if run.against is not None:
        run.against = run.against.resolve()
    return run


def benchmark(name: str, entry: Mapping[str, Any]) -> tuple[Callable[[Run], bool | None], str]:
    """What is run, and what it says of itself: ``main`` of its module, or the function of its name in another's."""
    module = importlib.import_module(f"benchmarks.{entry.get('module', name)}")
    if "module" not in entry:
        return module.main, module.__doc__ or ""
    return getattr(module, name), inspect.getdoc(getattr(module, name)) or ""


def show_list(entries: Mapping[str, Mapping[str, Any]]) -> None:
    """Print every benchmark with its claim."""
    print(__doc__)
    for name, entry in entries.items():
        print(f"{name:24} {entry['claim']}")


def main(arguments: Sequence[str]) -> int:
    """Do what the arguments ask for; the exit code."""
    entries = registry()
    name = arguments[0] if arguments else ""
    if name == "figures":
        return _figures(arguments[1:], entries)
    if name == "all":
        options = argparse.ArgumentParser(prog="python -m benchmarks all", description=figures.measure_stale.__doc__)
        options.add_argument("--minutes", type=float, default=np.inf, help="begin no row after this time")
        return LEFT if figures.measure_stale(entries, options.parse_args(arguments[1:]).minutes) else 0
    if name not in entries:
        show_list(entries)
        if name in ("", "--help", "-h"):
            return 0
        print(f"\nbenchmark: found {name}, allowed are the names above", file=sys.stderr)
        return 2
    entry = entries[name]
    work, said = benchmark(name, entry)
    run = parsed(name, arguments[1:], said)
    if run.write and run.quick:
        raise SystemExit("--write: found --quick, allowed is the full size: a small run is no figure")
    if run.against is not None and not entry.get("against", False):
        before = ["", *arguments]
        own = [a for a, last in zip(arguments, before, strict=False) if "--against" not in (a.partition("=")[0], last)]
        return with_packages_of(run.against, own)
    answer = work(run)
    good = answer is None or bool(answer)
    if run.left:
        print(f"{run.left} cases are left: run the same command again", file=sys.stderr)
    if run.write and good:
        for row, text in run.figures.items():
            figures.store(row, text, f"`python -m benchmarks {' '.join(a for a in arguments if a != '--write')}`", name)
        figures.write(entries)
    return LEFT if good and run.left else int(not good)


def _figures(arguments: Sequence[str], entries: dict[str, dict[str, Any]]) -> int:
    options = argparse.ArgumentParser(
        prog="python -m benchmarks figures", description=figures.__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )  # fmt: skip
    options.add_argument("--row", help="give this row a new figure")
    options.add_argument("--figure", help="its text")
    options.add_argument("--command", default="", help="what printed it, where it is another command than before")
    given = options.parse_args(arguments)
    if given.row is not None:
        if given.figure is None:
            options.error("--figure is missing: what was read off")
        figures.store(given.row, given.figure, given.command)
    figures.write(entries)
    return 0
