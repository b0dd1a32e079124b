"""How many planted faults do the tests find? Each mutation of `mutations.toml` is made in a copy of a checkout, alone.

A mutation is killed when a test of its own package fails: the file of tests of its name first, then the folders above
it, up to all the package's tests, each until the first failure. What hangs for HANG_S is killed, too. ``--out`` keeps
each outcome as a line of JSON; what stands there is not run again. Prints a line a mutation and the shares.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
import tomllib
from collections import Counter
from pathlib import Path

from benchmarks.runner import ROOT, Run

HANG_S = 1800.0
LARGE = 3
"""Folders less than this deep under ``tests`` are shared out to two processes."""


def stages(file: str, checkout: Path) -> list[str]:
    """Tests of a source file, the nearest first."""
    source = Path(file)
    found = [Path("tests") / source.parent / f"test_{source.stem}.py"]
    found += [Path("tests") / folder for folder in source.parents if folder != Path(".")]
    return [path.as_posix() for path in found if (checkout / path).exists()]


def mutate(checkout: Path, mutation: dict[str, str]) -> str | None:
    """The text of the file before the mutation; None where its line is not there once."""
    path = checkout / mutation["file"]
    if not path.is_file():
        return None
    text = path.read_text(encoding="utf-8")
    lines = text.splitlines()
    places = [k for k, line in enumerate(lines) if line.strip() == mutation["line"]]
    if len(places) != 1:
        return None
    lines[places[0]] = lines[places[0]].replace(mutation["line"], mutation["becomes"])
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return text


def outcome(checkout: Path, mutation: dict[str, str], near: bool) -> tuple[str, str]:
    """``killed`` or ``survived``, and the test that failed; ``near``: without the tests of the whole package."""
    environment = {**os.environ, "PYTHONPATH": str(checkout)}
    done_before: list[str] = []
    for tests in stages(mutation["file"], checkout):
        if near and len(Path(tests).parts) < LARGE:
            break
        shared = ["-n", "2" if len(Path(tests).parts) < LARGE else "0"]
        command = [sys.executable, "-m", "pytest", "-q", "-x", "--no-header", *shared, tests, *done_before]
        done_before.append(f"--ignore={tests}")
        try:
            done = subprocess.run(
                command, cwd=checkout, env=environment, capture_output=True, text=True, timeout=HANG_S, check=False
            )
        except subprocess.TimeoutExpired:
            return "killed", f"{tests} hangs"
        if done.returncode not in (0, 5):  # 5: nothing to run there
            failed = [line for line in done.stdout.splitlines() if line.startswith(("FAILED", "ERROR"))]
            return "killed", (failed or done.stdout.splitlines()[-1:] or [tests])[0][:160]
    return "survived", ""


def main(run: Run) -> bool:
    """Print a line for each mutation and the share killed; whether as many are killed as are stated."""
    checkout, told = run.against or ROOT, Counter[str]()
    mutations = tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))["mutation"]
    with tempfile.TemporaryDirectory(prefix="mutations_") as place:
        copy = Path(place) / "checkout"
        shutil.copytree(checkout, copy, ignore=shutil.ignore_patterns(".git", "__pycache__", "_build"))

        def planted(number: int, near: bool, _: str) -> tuple[str, str]:
            before = mutate(copy, mutations[number])
            if before is None:
                return "gone", ""
            try:
                return outcome(copy, mutations[number], near)
            finally:
                (copy / mutations[number]["file"]).write_text(before, encoding="utf-8")

        numbers = run.only or range(len(mutations))
        for (number, *_), (said, by) in run.cases([(n, run.near, str(checkout)) for n in numbers], planted):
            told[said] += 1
            print(f"{number:2} {said:9}{mutations[number]['kind']:11}{mutations[number]['file']}  {by}", flush=True)
    ran = told["killed"] + told["survived"]
    print(f"killed {told['killed']} of {ran}" + (f", {told['gone']} no longer in the code" if told["gone"] else ""))
    run.figure("mutations", f"{told['killed']} of {ran}")
    return told["killed"] >= run.least * ran
