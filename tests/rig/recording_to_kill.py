"""A program to be killed: records the session named on each line of standard input in a process of its own.

Prints ``pid N``, then ``block TRIAL ACQUIRED COMMITTED`` after each block is acknowledged, ``end`` when the process is
gone. Where the system cannot fork, it records one session itself. Run by test_killed.py.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
from conftest import AlgebraicPlant, sensors

from rig.config import load_rig, parse_rig
from rig.profile import load_profile
from rig.recorder import record_session
from rig.simulated.backend import SimulatedBackend, build_device
from rig.simulated.clock import PacedClock
from rig.trial_run import Progress

TRIALS = 3
SPEED = 8.0


def say(text: str) -> None:
    os.write(1, f"{text}\n".encode())


def acknowledge(progress: Progress) -> None:
    say(f"block {progress.trial} {round(progress.time_s * 5000)} {round(progress.committed_s * 5000)}")


def record(folder: str) -> None:
    # without the watchdog, which a machine as busy as the one that runs the tests may trip
    rig = parse_rig(load_rig("virtual").text.replace("[watchdog]\ntimeout_s = 0.5\n", ""))
    device = build_device(rig.config, AlgebraicPlant(), sensors(noise_n=0.02), clock=PacedClock(SPEED))
    record_session(
        folder,
        profile=load_profile(Path(__file__).with_name("step.toml")),
        rig_config=rig,
        backend=SimulatedBackend(device),
        trials=TRIALS,
        progress=acknowledge,
    )


def main() -> None:
    for line in sys.stdin:
        if not hasattr(os, "fork"):
            say(f"pid {os.getpid()}")
            record(line.strip())
            continue
        if child := os.fork():
            say(f"pid {child}")
            os.waitpid(child, 0)
            say("end")
        else:
            record(line.strip())
            os._exit(0)


if __name__ == "__main__":
    main()
