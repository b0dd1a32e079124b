"""Tracking by one and by two threads, and where a frame's time goes: three bodies of 400 x 304, per texture.

    python -m benchmarks tracking_threads [--frames 600] [--turns 6]

One and two threads alternate; the best wall time of each counts, so that it says something on a machine at rest only.
The parts are processor time of the tracking thread (one thread): what leaves Python's lock to others, and what holds
it. With two threads, the parts before and after are shared out by bodies, frames and cameras. The RMS error of the
angles (jack and lever relative to the whippen) stands beside, and whether both gave the same bits.
"""

from __future__ import annotations

import tempfile
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np

import vision.fitting.frame_spline as frame_spline
import vision.fitting.icgn as icgn
import vision.frame_fit.frame_fit as frame_fit
import vision.tracking.track_film as track_film
from benchmarks.runner import Run, in_turns
from benchmarks.tracking_cases import blow
from rig.simulated import CameraSettings, film_bodies, film_trial

N_STILL = 64
PARTS = (
    (track_film, "prepare", "before the first frame"),
    (track_film, "assemble_result", "after the last frame"),
    (track_film, "track_forward", "frames"),
    (frame_fit, "walk", "  frames in one call (leaves the lock)"),
    (frame_fit, "fit_bodies", "  rest of a doubtful frame (leaves it)"),
    (frame_spline, "prefilter", "  spline filter, called by Python (leaves it)"),
    (icgn, "fit_rigid", "  fit, called by Python (leaves it)"),
)
LEAVES = "leaves"


def parts_of(run: Callable[[], Any]) -> Counter[str]:
    """Processor time (ns) of one run by part."""
    spent: Counter[str] = Counter()

    def timed(work: Callable[..., Any], name: str) -> Callable[..., Any]:
        def call(*arguments: Any, **named: Any) -> Any:
            start = time.thread_time_ns()
            try:
                return work(*arguments, **named)
            finally:
                spent[name] += time.thread_time_ns() - start

        return call

    kept = [(where, what, getattr(where, what)) for where, what, _ in PARTS]
    for where, what, name in PARTS:
        setattr(where, what, timed(getattr(where, what), name))
    try:
        start = time.thread_time_ns()
        run()
        spent["whole"] = time.thread_time_ns() - start
    finally:
        for where, what, work in kept:
            setattr(where, what, work)
    return spent


def main(asked: Run) -> bool:
    """Film, track, print; whether the bits are the same."""
    cv2.setNumThreads(1)
    same = True
    for texture in ("wood", "speckle"):
        settings = CameraSettings(texture=texture)
        times = 62.5e-6 + np.arange(asked.frames) / settings.frame_rate_hz
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "film.mraw"
            truth, bodies = film_trial(path, times, blow, settings=settings, seed=1), film_bodies(settings=settings)

            def run(threads: int, path: Path = path, bodies: Any = bodies, truth: Any = truth) -> Any:
                return track_film.track(path, bodies, truth.frame_time_s, n_still=N_STILL, threads=threads)

            jobs = {1: lambda run=run: run(1), 2: lambda run=run: run(2)}
            rates = [asked.frames / spent.min() for spent in in_turns(jobs, asked.turns, time.perf_counter).values()]
            angle = {threads: run(threads).angle_rad for threads in jobs}
            spent = min((parts_of(jobs[1]) for _ in range(3)), key=lambda one: one["whole"])
        same &= np.array_equal(angle[1], angle[2], equal_nan=True)
        true = truth.mean_angle_rad - truth.mean_angle_rad[:N_STILL].mean(axis=0)
        found = angle[1] - np.column_stack([np.zeros(len(true)), angle[1][:, 0], angle[1][:, 0]])
        rms = np.degrees(np.sqrt(np.mean((found - true) ** 2, axis=0))) * 1e3
        print(
            f"\n{texture}: {rates[0]:.0f} frames/s by one thread, {rates[1]:.0f} by two ({rates[1] / rates[0]:.2f} x)"
        )
        print(f"  RMS, mdeg: whippen {rms[0]:.2f}, jack {rms[1]:.2f}, lever {rms[2]:.2f}; same bits: {same}")
        free = sum(spent[name] for *_, name in PARTS if LEAVES in name)
        spent["  Python, and short compiled calls"] = spent["frames"] - free
        for name in (*(name for *_, name in PARTS), "  Python, and short compiled calls", "whole"):
            print(f"  {name:50s}{spent[name] / 1e3 / asked.frames:8.0f} us a frame")
        held, ends = spent["frames"] - free, spent["whole"] - spent["frames"]
        print(
            f"  of a frame's time {free / spent['frames']:.0%} leaves the lock; with all else done alone, two threads "
            f"give at most {spent['whole'] / (max(0.5 * spent['frames'], held) + ends):.2f} x"
        )
    return bool(same)
