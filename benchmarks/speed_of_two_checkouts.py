"""Is this checkout as fast as another? Jobs alternate between the two; the ratio of their medians is printed.

Jobs: start-up and whole run of ``--help``, ``simulate``, an unchanged and a cold ``validate`` (wall time of a process);
a forte at 1e-5 rad in a warm process, tracking a rendered film of 300 frames, the first compilation of the kernels
(processor time inside the process). The first turn of each is not counted. The upper limit is that of a 95 % bootstrap
interval of the ratio of medians; above 1.05 is wrong. Each result is checked: a job prints a figure that
must be equal in both checkouts.
"""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path

import numpy as np

import vision
from benchmarks.runner import ROOT, Checkout, Run, Table, checkouts
from benchmarks.tracking import blow
from rig.simulated import CameraSettings, film_bodies, film_trial

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
vision.track(sys.argv[1], bodies)
best = []
for _ in range(3):
    start = time.process_time()
    result = vision.track(sys.argv[1], bodies)
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


def measured(job: str, checkout: Checkout, folder: Path) -> tuple[float, str]:
    """Seconds for one turn of a job, and the figure that must be the same in both checkouts."""
    if job in ("forte", "track", "compile"):
        code = {"forte": FORTE, "track": TRACK, "compile": COMPILE}[job]
        more = [str(folder / "film.mraw"), str(folder / "bodies.toml")] if job == "track" else []
        with tempfile.TemporaryDirectory() as cache:
            variables = {"PIANORIG_CACHE_DIR": cache} if job == "compile" else {}
            seconds, figure = checkout.run("-c", code, *more, **variables)[2].split()
        return float(seconds), figure
    session = folder / checkout.root.name / "session"
    if job == "cold-validate":
        shutil.rmtree(session.parent, ignore_errors=True)
    if job.endswith("validate") and not session.exists():
        shutil.copytree(ROOT / "sessions" / "example_forte", session, ignore=shutil.ignore_patterns("derived"))
    out = folder / checkout.root.name / "out.csv"
    out.parent.mkdir(exist_ok=True)
    arguments = {
        "help": ["--help"],
        "simulate": ["simulate", "--force", str(ROOT / "tests/model/data/forte_force.csv"), "--out", str(out)],
        "validate": ["validate", str(session)],
        "cold-validate": ["validate", str(session)],
    }[job]
    seconds, _, _ = checkout.run("-c", COMMAND, *arguments)
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
    settings = CameraSettings()
    film_trial(folder / "film.mraw", np.arange(300) / settings.frame_rate_hz, blow, settings=settings)
    vision.save_bodies(folder / "bodies.toml", film_bodies(settings=settings))


def main(run: Run) -> bool:
    """Measure every job in turns; print a row for each; whether none is slower."""
    both, fine = checkouts(run), True
    table = Table("job:14s", "turns:d", "other s:.4f", "this s:.4f", "ratio:.3f", "upper 95 %:.3f", "limit:s")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        if "track" in run.only:
            render_film(folder)
        for job in run.only:
            turns = min(run.turns, LONG.get(job, run.turns))
            times = np.empty((turns + 1, 2))
            for turn in range(turns + 1):
                found = [measured(job, checkout, folder) for checkout in both]
                times[turn] = [seconds for seconds, _ in found]
                figures = [figure for _, figure in found]
                if not agree(job, *figures):
                    raise SystemExit(f"{job}: different answers: {figures[0][:80]} and {figures[1][:80]}")
            old, new = times[1:].T
            limit, ratio = upper_limit(old, new), np.median(new) / np.median(old)
            slower = limit > LARGEST_RATIO
            fine &= not slower
            table.row(job, turns, np.median(old), np.median(new), ratio, limit, "ABOVE 1.05" if slower else "")
    return fine
