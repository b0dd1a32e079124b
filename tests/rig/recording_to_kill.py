"""A program to be killed: records the session named on each line of standard input in a process of its own.

Prints ``pid N``, then ``block TRIAL ACQUIRED COMMITTED`` after each block is acknowledged, ``end`` when the process is
gone. Behind a tab a line may name a step of sealing a trial, one of STEPS, at which the process kills itself. Where the
system cannot fork, it records one session itself. Run by test_killed.py.
"""

from __future__ import annotations

import os
import signal
import sys
from pathlib import Path
from typing import NoReturn

sys.path.insert(0, str(Path(__file__).parent))
from fake_backend import FakeBackend

from rig import Progress, load_profile, load_rig, platform_calls
from rig import record as record_session
from rig.session.journal_writer import JournalWriter
from rig.session.sealed_trial import Content

TRIALS = 3
SPEED = 5.0
"""Of the bench; the writing thread has a fifth of the time it has at the bench, on a machine that may be busy."""
step = ""


def say(text: str) -> None:
    os.write(1, f"{text}\n".encode())


def killed(*arguments: object, **options: object) -> NoReturn:
    os.kill(os.getpid(), signal.SIGKILL)
    raise AssertionError("still there")


STEPS = {
    "before the closing record": (JournalWriter, "close", killed),
    "half the sealed file": (Content, "close", killed),
    "before it is on the disk": (platform_calls, "synchronise_whole", killed),
    "before it has its name": (os, "replace", killed),
    "before the journal goes": (platform_calls, "remove", killed),
}


def acknowledge(progress: Progress) -> None:
    if step and progress.trial == 2:
        setattr(*STEPS[step])
    say(f"block {progress.trial} {round(progress.time_s * 5000)} {round(progress.committed_s * 5000)}")


def record(folder: str) -> None:
    record_session(
        folder,
        profile=load_profile(Path(__file__).with_name("step.toml")),
        rig_config=load_rig("virtual"),
        backend=FakeBackend(noise_n=0.02, speed=SPEED),
        trials=TRIALS,
        progress=acknowledge,
    )


def main() -> None:
    global step
    for line in sys.stdin:
        line, _, step = line.strip().partition("\t")
        if not hasattr(os, "fork"):
            say(f"pid {os.getpid()}")
            record(line)
            continue
        if child := os.fork():
            say(f"pid {child}")
            os.waitpid(child, 0)
            say("end")
        else:
            record(line)
            os._exit(0)


if __name__ == "__main__":
    main()
