"""Is this checkout as fast as another? Jobs alternate between the two; the ratio of their medians is printed.

Run:  python benchmarks/speed_of_two_checkouts.py OTHER_CHECKOUT [--turns 20] [--only simulate,forte]

Jobs: start-up and whole run of ``--help``, ``simulate``, an unchanged and a cold ``validate`` (wall time of a process);
a forte at 1e-5 rad in a warm process, tracking a rendered film of 300 frames, the first compilation of the kernels
(processor time inside the process). The first turn of each is not counted. The upper limit is that of a 95 % bootstrap
interval of the ratio of medians; above 1.05 the exit code is 1. Each result is checked: a job prints a figure that
must be equal in both checkouts.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
LARGEST_RATIO = 1.05
LONG = {"compile": 5, "cold-validate": 10}
"""Jobs of many seconds get fewer turns."""
COMMAND = "import sys; from pianorig.cli import main; main(sys.argv[1:])"
FORTE = """
import time, numpy as np, model
time_s = np.arange(3001) * 2e-4
knots = [0, 0.05, 0.07, 0.09, 0.11, 0.1125, 0.115, 0.118, 0.3, 0.39, 1]
force = np.interp(time_s, knots, [0, 0, 1.4, 4.9, 10, 27, 15, 10, 10, 0, 0])
action = model.load_action()
model.simulate(action, time_s, force, tolerance=1e-5)
best = []
for _ in range(30):
    start = time.process_time()
    blow = model.simulate(action, time_s, force, tolerance=1e-5)
    best.append(time.process_time() - start)
print(min(best), repr(float(blow.angle_rad[-1, 4])))
"""
TRACK = """
import sys, time, vision
source = vision.open_film(sys.argv[1])
bodies = vision.load_bodies(sys.argv[2])
vision.track_film(sys.argv[1], bodies)
best = []
for _ in range(3):
    start = time.process_time()
    result = vision.track_film(sys.argv[1], bodies)
    best.append(time.process_time() - start)
print(min(best), repr(float(result.angle_rad[150].sum())))
"""
COMPILE = """
import time, numpy as np, model
start = time.process_time()
time_s = np.arange(0, 501) * 2e-4
blow = model.simulate(model.load_action(), time_s, np.full(501, 2.0), tolerance=1e-5)
print(time.process_time() - start, repr(float(blow.angle_rad[-1, 4])))
"""


def run(checkout: Path, arguments: list[str], **variables: str) -> tuple[float, str]:
    """Wall time of a Python process running the source of ``checkout``, and its output."""
    environment = os.environ | {"PYTHONPATH": str(checkout)} | variables
    start = time.perf_counter()
    done = subprocess.run(
        [sys.executable, "-P", *arguments], env=environment, cwd=tempfile.gettempdir(), capture_output=True, text=True
    )
    elapsed = time.perf_counter() - start
    if done.returncode:
        raise SystemExit(f"{checkout}: {arguments[:4]}: exit {done.returncode}\n{done.stderr}")
    return elapsed, done.stdout


def measured(job: str, checkout: Path, folder: Path) -> tuple[float, str]:
    """Seconds for one turn of a job, and the figure that must be the same in both checkouts."""
    if job in ("forte", "track", "compile"):
        code = {"forte": FORTE, "track": TRACK, "compile": COMPILE}[job]
        more = [str(folder / "film.mraw"), str(folder / "bodies.toml")] if job == "track" else []
        with tempfile.TemporaryDirectory() as cache:
            variables = {"PIANORIG_CACHE_DIR": cache} if job == "compile" else {}
            seconds, figure = run(checkout, ["-c", code, *more], **variables)[1].split()
        return float(seconds), figure
    session = folder / checkout.name / "session"
    if job == "cold-validate":
        shutil.rmtree(session.parent, ignore_errors=True)
    if job.endswith("validate") and not session.exists():
        shutil.copytree(ROOT / "sessions" / "example_forte", session, ignore=shutil.ignore_patterns("derived"))
    out = folder / checkout.name / "out.csv"
    out.parent.mkdir(exist_ok=True)
    arguments = {
        "help": ["--help"],
        "simulate": ["simulate", "--force", str(ROOT / "tests/model/data/forte_force.csv"), "--out", str(out)],
        "validate": ["validate", str(session)],
        "cold-validate": ["validate", str(session)],
    }[job]
    seconds, _ = run(checkout, ["-c", COMMAND, *arguments])
    return seconds, out.read_text("utf-8") if job == "simulate" else ""


def agree(job: str, other: str, this: str) -> bool:
    """Are two figures the same? Sums over pixels depend on memory alignment: film angles agree to 1e-7 rad."""
    return abs(float(other) - float(this)) < 1e-7 if job == "track" else other == this


def upper_limit(old: np.ndarray, new: np.ndarray) -> float:
    """Upper 95 % limit of the ratio of medians, by resampling turns."""
    random = np.random.default_rng(1)
    draws = random.integers(0, len(old), (4000, len(old)))
    return float(np.quantile(np.median(new[draws], axis=1) / np.median(old[draws], axis=1), 0.95))


def render_film(folder: Path) -> None:
    """Render a film of three moving bodies with this checkout's virtual camera."""
    code = (
        "import sys; from pathlib import Path; import numpy as np; sys.path.insert(0, 'benchmarks');"
        "from filmed_blow import blow;"
        "from rig.simulated import CameraSettings, film_bodies, film_trial; import vision;"
        "s = CameraSettings(); t = np.arange(300) / s.frame_rate_hz; d = Path(sys.argv[1]);"
        "film_trial(d / 'film.mraw', t, blow, settings=s);"
        "vision.save_bodies(d / 'bodies.toml', film_bodies(settings=s))"
    )
    subprocess.run([sys.executable, "-c", code, str(folder)], cwd=ROOT, check=True)


def main() -> int:
    """Measure every job in turns; print a row for each."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("other", type=Path)
    parser.add_argument("--turns", type=int, default=20)
    parser.add_argument("--only", default="help,simulate,validate,cold-validate,forte,track,compile")
    given = parser.parse_args()
    other, fine = given.other.resolve(), True
    print("job            turns  other (s)  this (s)  ratio  upper 95 %")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        jobs = given.only.split(",")
        if "track" in jobs:
            render_film(folder)
        for job in jobs:
            turns = min(given.turns, LONG.get(job, given.turns))
            times: tuple[list[float], list[float]] = ([], [])
            for turn in range(turns + 1):
                figures = []
                for side, checkout in enumerate((other, ROOT)):
                    seconds, figure = measured(job, checkout, folder)
                    figures.append(figure)
                    if turn:
                        times[side].append(seconds)
                if not agree(job, *figures):
                    raise SystemExit(f"{job}: different answers: {figures[0][:80]} and {figures[1][:80]}")
            old, new = np.array(times[0]), np.array(times[1])
            limit = upper_limit(old, new)
            fine &= limit <= LARGEST_RATIO
            ratio = np.median(new) / np.median(old)
            row = f"{job:14} {turns:5d} {np.median(old):10.4f} {np.median(new):9.4f} {ratio:6.3f} {limit:8.3f}"
            print(row + ("" if limit <= LARGEST_RATIO else "  ABOVE 1.05"), flush=True)
    return 0 if fine else 1


if __name__ == "__main__":
    sys.exit(main())
