"""Two processes that start together compile once: the second waits for the first, and for no one who died."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from model.kernels.process_lock import hold_lock

WORK = """
import sys, os
from pathlib import Path
from model.kernels.process_lock import hold_lock
folder = Path(sys.argv[1])
print("ready", flush=True)
sys.stdin.readline()
with hold_lock(folder, "scene"):
    made = folder / "made"
    if not made.exists():
        made.touch()
        print("made", flush=True)
        if sys.argv[2] == "dies":
            os._exit(1)
        sys.stdin.readline()
        with open(folder / "log", "a") as log:
            log.write("done ")
    else:
        with open(folder / "log", "a") as log:
            log.write("found ")
"""


def start(folder: Path, what: str = "") -> subprocess.Popen[str]:
    process = subprocess.Popen(
        [sys.executable, "-c", WORK, str(folder), what], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    assert process.stdout is not None and process.stdout.readline() == "ready\n"
    return process


def tell(process: subprocess.Popen[str]) -> None:
    assert process.stdin is not None
    process.stdin.write("\n")
    process.stdin.flush()


def test_the_second_waits_and_finds_what_the_first_has_made(tmp_path: Path) -> None:
    first, second = start(tmp_path), start(tmp_path)
    tell(first)
    assert first.stdout is not None and first.stdout.readline() == "made\n"
    tell(second)  # held up by the first
    tell(first)
    assert first.wait() == second.wait() == 0
    assert (tmp_path / "log").read_text() == "done found "
    for process in (first, second):
        process.communicate()


def test_nobody_waits_for_a_process_that_died(tmp_path: Path) -> None:
    first = start(tmp_path, "dies")
    tell(first)
    assert first.wait() == 1
    first.communicate()
    (tmp_path / "made").unlink()
    with hold_lock(tmp_path, "scene"):
        (tmp_path / "made").touch()
    assert (tmp_path / "made").exists()


def test_without_a_cache_folder_there_is_nothing_to_hold(tmp_path: Path) -> None:
    with (
        hold_lock(None, "scene"),
        hold_lock(tmp_path / "absent", "scene"),
        hold_lock(tmp_path, "a"),
        hold_lock(tmp_path, "b"),
    ):
        pass
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.lock", "b.lock"]
