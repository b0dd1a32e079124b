"""Do values identified from motion-driven trials, films and mixed sessions hold? On virtual strokes with known truth.

    python -m benchmarks identification_channels [--ways force,motion,film,mixed] [--kinds forte,double] [--trials 5]
                                                 [--free 5] [--spread 0.5] [--seeds 1,2] [--results FILE]

The specimen is the model with N laws drawn from their priors (those of them that act between whippen and hammer), all
else known; errors of force, encoders and camera are drawn once for all trials, frictions scatter by 2 % from trial to
trial. The same trials are fitted in each way: ``force`` drives; the measured ``motion`` of the key drives; force with
``film`` of jack and repetition lever beside the encoders; ``mixed``: the first kind by force, the others by motion, all
filmed, in one fit. Printed: error over u of every law, how many 95 % intervals hold the truth, u, processor time.
"""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd

import model
from benchmarks.identification_coverage import LAWS, RUNS, Sensors, drawn_truth, played, tested
from benchmarks.runner import Run, Table, may_be
from rig.session import CameraInfo, TrialData
from validation.conventions import FILM_CHANNELS, JACK, REPETITION, Array
from validation.identification.estimates import estimate_all
from validation.identification.identify import LEAST_EFFECT_RAD, held_columns
from validation.identification.minima import search
from validation.identification.motion_runs import response_to
from validation.identification.observations import (
    ObservedTrial,
    observe,
    observe_driven,
    sharing_the_key,
    with_errors_of_what_drives,
)
from validation.identification.problem import Problem
from validation.identification.scatter import lacking
from validation.identification.unknowns import Unknowns, unknowns
from validation.measurement.trial import MeasuredTrial, measure

FRAMES_HZ, FILM_NOISE_RAD, FILM_SCALE, U_CLOCK_S, LOST = 2000.0, 3e-4, 1e-3, 2e-5, 0.02


class Camera:
    """A film's errors, drawn once: scale and clock; noise and lost frames of each film."""

    def __init__(self, rng: np.random.Generator) -> None:
        self.scale, self.late_s = FILM_SCALE * rng.standard_normal(2), U_CLOCK_S * rng.standard_normal()

    def film(self, t: np.ndarray, turn: np.ndarray, rng: np.random.Generator) -> tuple[CameraInfo, pd.DataFrame]:
        """Frame clock and track table of one trial; ``turn`` (n, 2) of jack and repetition lever."""
        n = int((t[-1] - 0.01) * FRAMES_HZ)
        camera = CameraInfo(FRAMES_HZ, 0.003, 1e-4, n, U_CLOCK_S)
        columns: dict[str, Any] = {"time_s": camera.frame_time_s}
        for c, name in enumerate(FILM_CHANNELS):
            seen = np.interp(camera.frame_time_s - self.late_s, t, turn[:, c]) * (1 + self.scale[c])
            seen = seen + FILM_NOISE_RAD * rng.standard_normal(n)
            seen[rng.uniform(size=n) < LOST] = np.nan
            columns[f"{name}_relative_rad"] = seen
            columns[f"{name}_relative_u_rad"] = np.full(n, FILM_NOISE_RAD)
            columns[f"{name}_relative_u_total_rad"] = np.hypot(FILM_NOISE_RAD, FILM_SCALE * np.abs(np.nan_to_num(seen)))
        return camera, pd.DataFrame(columns)


def filmed(
    specimen: model.Action, kind: str, n: int, bench: tuple[Sensors, Camera], rng: np.random.Generator
) -> list[tuple[TrialData, pd.DataFrame]]:
    """Filmed trials of one kind on a specimen that the model can be."""
    sensors, camera = bench

    def read(number: int, t: Array, force: Array, turn: Array, rng: np.random.Generator) -> Any:
        info, film = camera.film(t, turn[:, [JACK, REPETITION]], rng)
        return replace(sensors.read(number, t, force, turn, rng), camera=info), film

    return played(specimen, kind, n, sensors, rng, read)


def seen_as(way: str, by_kind: dict[str, list[MeasuredTrial]]) -> list[ObservedTrial]:
    """The trials as a fit of this way sees them."""
    film, out = way in ("film", "mixed"), []
    for i, (kind, measured) in enumerate(by_kind.items()):
        by_key = way == "motion" or (way == "mixed" and i > 0)
        out += (observe_driven if by_key else observe)(kind, i, measured, film=film)
    return sharing_the_key(out)


def acting(start: model.Action, trials: list[ObservedTrial]) -> list[str]:
    """Laws that move a compared channel of these trials, seen from the first of each session."""
    free = with_errors_of_what_drives(unknowns(start, LAWS, ["*"]), trials)
    first = list({t.session: t for t in trials[::-1]}.values())
    columns = response_to(start, free.asked, first).jacobian(np.zeros(len(free.asked)), range(len(free.asked)))
    size = np.max([np.abs(c).max(axis=(0, 1)) for c in columns], axis=0)
    return [p.name for p, s in zip(free.asked, size, strict=True) if s > LEAST_EFFECT_RAD]


def fitted(start: model.Action, free: Unknowns, trials: list[ObservedTrial], truth: dict[str, float]) -> dict[str, Any]:
    """Errors, u and processor time of one fit."""
    began = time.process_time()
    free = with_errors_of_what_drives(free, trials)
    response = response_to(start, (*free.moved, *free.held), trials, RUNS)
    problem = Problem(start, free, tuple(trials), response, held_columns(response, free))
    best = search(problem, 1, None, None)[0]
    took = time.process_time() - began
    rows = []
    for e, p in zip(estimate_all(problem, best, (), lambda text: None), free.asked, strict=True):
        true = p.physical(start, truth[e.name])
        rows.append(
            {"name": e.name, "true": truth[e.name], "z": e.z, "u": e.z_u, "inside": bool(e.low <= true <= e.high)}
        )
    out = {"estimates": rows, "converged": best.converged, "lacking": lacking(best), "processor_s": took}
    return out | {"steps": best.steps}


def experiment(seed: int, options: Run) -> dict[str, Any]:
    """One specimen, fitted in every way."""
    rng = np.random.default_rng([seed, 160])
    start = model.load_action()
    bench = Sensors(rng), Camera(rng)

    def measured(specimen: model.Action, n: int, random: np.random.Generator) -> dict[str, list[MeasuredTrial]]:
        return {
            kind: [measure(d, film, tested().geometry_at(d.force_info.preload_n)) for d, film in some]
            for kind in options.kinds
            for some in [filmed(specimen, kind, n, bench, random)]
        }

    names = acting(start, seen_as("motion", measured(start, 1, np.random.default_rng(0))))
    free = unknowns(start, [str(name) for name in rng.choice(names, options.free, replace=False)], ["*"])
    truth, specimen = drawn_truth(start, free, options.spread, rng)
    by_kind = measured(specimen, options.trials, rng)
    return {way: fitted(start, free, seen_as(way, by_kind), truth) for way in options.ways}


def main(run: Run) -> bool:
    """Print the table; whether intervals may hold the truth as often as stated."""
    good = True
    same = [run.ways, run.kinds, run.trials, run.free, run.spread]
    errors: dict[str, list[tuple[float, bool]]] = {}
    for (seed, *_), ways in run.cases([(seed, *same) for seed in run.seeds], lambda seed, *_: experiment(seed, run)):
        for way, found in ways.items():
            settled = "settled" if found["converged"] else "NOT settled"
            print(
                f"seed {seed}, {way}: {settled} in {found['steps']} steps, discrepancy {found['lacking']:.3f}, "
                f"{found['processor_s']:.0f} s of processor time"
            )
            table = Table("law:30s", "true z:+6.2f", "found z:+6.2f", "u:.3f", "error/u:+5.2f")
            for e in found["estimates"]:
                ratio = (e["z"] - e["true"]) / e["u"]
                errors.setdefault(way, []).append((ratio, e["inside"]))
                table.row(e["name"], e["true"], e["z"], e["u"], ratio)
    for way, some in errors.items():
        rms = float(np.sqrt(np.mean([r**2 for r, _ in some])))
        hold = sum(inside for _, inside in some)
        print(f"{way:7s} {len(some)} laws: error over u {rms:.2f} RMS, {hold} of {len(some)} 95 % intervals hold")
        good &= may_be(0.95, hold, len(some))
    return good
