"""Disturbed films: how far off the tracker is, what it says about it, and what it loses.

    python -m benchmarks tracking_stress [--seeds 20] [--kinds dust,jpeg]
    python -m benchmarks tracking_stress --results stress.jsonl --minutes 5     # again until it is whole

Prints per kind of disturbance and texture, over all seeds: RMS error and median stated uncertainty of the angle (mdeg),
the share of rows whose 95 % interval covers the truth, silent rows (no flag, or ``WIDENED`` alone, and an error above
five stated uncertainties), rows with any other flag, lost rows, rows in all; flagged and lost rows of films that
``permit`` tracking, whose bound (least error that the film's noise permits) is at most a quarter of 0.05 degrees; rows
that are only ``WIDENED``, which count as usable. The films come from `stress_films`, which shares no code with
`vision`. Only moving rows count; the zero is that of the still frames.
H.264 needs PyAV (``pip install av``).
"""

from __future__ import annotations

import sys
import warnings
from dataclasses import asdict, dataclass

import numpy as np

import vision
from benchmarks.runner import Run, Table
from benchmarks.stress_films import KINDS, STILL, stress_film
from vision.results.flags import FrameFlag

PERMITS_MDEG = 12.5


@dataclass(frozen=True)
class Row:
    """Errors and u (mdeg) of the rows found; silent, flagged, lost and all rows; flagged or lost and
    all rows, where the bound permits tracking; rows whose only flag is ``WIDENED``."""

    error: list[float]
    u: list[float]
    silent: int
    flagged: int
    lost: int
    rows: int
    permit_bad: int
    permit_rows: int
    widened: int = 0


def track_one(kind: str, surface: str, seed: int, n_still: int) -> Row:
    """Render and track one film; ``n_still`` 0: the tracker finds its still frames."""
    film = stress_film(kind, surface, seed)
    source = vision.ArrayFilm(film.frames, frame_rate_hz=2000.0)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            result = vision.track(source, [vision.Body("bar", film.outline_px)], n_still=n_still or None)
        except vision.VisionInputError as error:
            print(f"{kind}, {surface}, {seed}: {error}", file=sys.stderr)
            rows = len(film.frames) - STILL
            permits = rows if np.degrees(film.bound_rad) * 1e3 <= PERMITS_MDEG else 0
            return Row([], [], 0, 0, rows, rows, permits, permits)
    still = min(result.n_still, STILL)
    error = (result.angle_rad[:, 0] - film.angle_rad + film.angle_rad[:still].mean())[STILL:]
    u, flag = result.u_angle_rad[STILL:, 0], result.flag[STILL:, 0].astype(int)
    widened = int(np.sum(flag == int(FrameFlag.WIDENED)))
    # usable, so that it must not be silently wrong either
    flag &= ~int(FrameFlag.WIDENED)
    found = np.isfinite(error)
    silent = int(np.sum((flag[found] == 0) & (np.abs(error[found]) > 5.0 * u[found])))
    flagged, lost = int(np.sum(flag[found] != 0)), int(np.sum(~found))
    scale = 1e3 * 180.0 / np.pi
    permits = film.bound_rad * scale <= PERMITS_MDEG
    bad, rows = (flagged + lost, error.size) if permits else (0, 0)
    errors, us = ((values[found] * scale).round(4).tolist() for values in (error, u))
    return Row(errors, us, silent, flagged, lost, error.size, bad, rows, widened)


def joined(rows: list[Row]) -> Row:
    """All rows of several films."""
    names = ("silent", "flagged", "lost", "rows", "permit_bad", "permit_rows", "widened")
    error, u = (sum((getattr(row, name) for row in rows), []) for name in ("error", "u"))
    return Row(error, u, *(sum(getattr(row, name) for row in rows) for name in names))


def main(run: Run) -> bool:
    """Render, track, print; whether at most 0.1 % of all rows are silently wrong."""
    if "h264" not in KINDS:
        print("H.264 is left out: PyAV is not installed (pip install av)", file=sys.stderr)
    kinds, seeds = run.kinds or list(KINDS), range(run.first_seed, run.first_seed + run.seeds)
    keys = [(kind, surface, seed, run.n_still) for seed in seeds for kind in kinds for surface in run.textures]
    found: dict[tuple[str, str], list[Row]] = {(kind, surface): [] for kind in kinds for surface in run.textures}
    for (kind, surface, *_), row in run.cases(keys, lambda *key: asdict(track_one(*key))):
        found[kind, surface].append(Row(**row))
    table = Table(
        "kind:18s", "texture:8s", "rms_mdeg:.2f", "u_mdeg:.2f", "coverage:.3f", "silent:d", "flagged:d", "lost:d",
        "rows:d", "permit_bad:d", "permit_rows:d", "widened:d",
    )  # fmt: skip
    found["all", "all"] = [row for rows in found.values() for row in rows]
    for name, rows in found.items():
        one = joined(rows)
        error, u = np.array(one.error), np.array(one.u)
        sizes = [np.nan] * 3
        if error.size:
            sizes = [np.sqrt(np.mean(error**2)), np.median(u), np.mean(np.abs(error) < 1.96 * u)]
        counts = one.silent, one.flagged, one.lost, one.rows, one.permit_bad, one.permit_rows, one.widened
        table.row(*name, *sizes, *counts)
    covered, bad = sizes[2], 100 * one.permit_bad / max(one.permit_rows, 1)
    run.figure(
        "tracking-stress",
        f"{one.silent} silent of {one.rows:,} rows, 95 % interval covers {covered:.3f}, flagged or lost where the "
        f"noise permits tracking {bad:.1f} % (10 asked)",
    )
    return one.silent <= 0.001 * one.rows
