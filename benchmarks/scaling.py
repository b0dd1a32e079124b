"""How processor time and peak memory of a process grow with the size of a job; slopes in log-log.

A slope is that between a size and the one before it, of the time of a job done for the second time (of trials: of a
report in a new process); memory holds what Python and its packages take. Wrong is a slope above 1.2, but for bodies,
each of which brings contacts of its own.
"""

from __future__ import annotations

import multiprocessing
import resource
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np

import model
from benchmarks import report, tracking
from benchmarks.batches import TOLERANCE, trials
from benchmarks.runner import Run, Table
from benchmarks.sensitivities import sixty
from rig.simulated import CameraSettings, film_bodies, film_trial
from vision.tracking.track_film import track as track_film


def _filmed(n: int) -> Callable[[], object]:
    folder, settings = tempfile.mkdtemp(), CameraSettings(texture="speckle")
    path, times = Path(folder) / "film.mraw", 62.5e-6 + np.arange(n) / settings.frame_rate_hz
    truth = film_trial(path, times, tracking.blow, settings=settings, seed=1)
    return lambda: track_film(path, film_bodies(settings=settings), truth.frame_time_s, n_still=20)


def _played(n: int, bodies: bool) -> Callable[[], object]:
    action, blow = model.load_action("hirschkorn2004-regulated"), model.force_table("forte")
    if bodies:
        scene = model.SceneChoice(("key", "hammer", "whippen", "jack", "repetition")[:n])
        return lambda: model.simulate(action, *blow, scene=scene)
    strung = action.with_effects({"string.modes": float(n)})
    return lambda: model.simulate(strung, *blow, scene="string")


def _many(n: int) -> Callable[[], object]:
    action, few = model.load_action(), np.linspace(0.0, 0.7, 10)
    return lambda: model.simulate_many(action, trials(n), tolerance=TOLERANCE, workers=1, output_time_s=few)


def _differentiated(n: int) -> Callable[[], object]:
    action, blow = model.load_action(), model.force_table("forte")
    return lambda: model.sensitivities(action, blow, sixty(action)[:n])


SIZES: dict[str, tuple[Callable[[int], Callable[[], object]] | None, tuple[int, ...]]] = {
    "trials": (None, (1, 10, 100, 1000)), "frames": (_filmed, (100, 300, 1000, 3000)),
    "parameters": (_differentiated, (1, 4, 15, 60)), "bodies": (lambda n: _played(n, True), (1, 2, 3, 4, 5)),
    "modes": (lambda n: _played(n, False), (5, 10, 20, 40, 80)), "members": (_many, (16, 64, 256, 1024, 4096)),
}  # fmt: skip


def measured(what: str, size: int) -> tuple[float, float]:
    """Processor time (s) and peak memory (MB) of a size, in a process of its own that has done it once."""
    made, _ = SIZES[what]
    if made is None:
        with tempfile.TemporaryDirectory() as place:
            found = report.validate(report.make_session(Path(place) / "session", size))
        return found["cpu_s"], found["kb"] / 1024.0
    work = made(size)
    work()
    began = time.process_time()
    work()
    return time.process_time() - began, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0


def alone(what: str, size: int) -> tuple[float, float]:
    """`measured` in a new process."""
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
        return pool.submit(measured, what, size).result()


def main(run: Run) -> bool:
    """Print the table; whether no slope is too steep."""
    good, said = True, list[str]()
    table = Table("of:10s", "size:6d", "s:9.3f", "slope:.2f", "MB:8.0f", "MB more each:.3f")
    for what in run.only:
        keys = [(what, size) for size in SIZES[what][1] if size <= run.most]
        rows: list[tuple[int, float, float]] = []
        for (_, size), (seconds, memory) in run.cases(keys, alone):
            slope = each = None
            if rows:
                last, spent, held = rows[-1]
                slope = float(np.log(seconds / spent) / np.log(size / last))
                each = (memory - held) / (size - last)
                good &= slope < 1.2 or what == "bodies"
            table.row(what, size, seconds, slope, memory, each)
            rows.append((size, seconds, memory))
        if len(rows) > 1:
            (few, least_s, _), (many, most_s, _) = rows[0], rows[-1]
            over = np.log(most_s / least_s) / np.log(many / few)
            said.append(f"{what} {few} to {many} {over:.2f}, {slope:.2f}, {each:.2f}")
    run.figure("scaling", "; ".join(said))
    return good
