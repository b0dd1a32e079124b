"""Disturbed films: how far off the tracker is, what it says about it, and what it loses.

    python benchmarks/tracking_stress.py [--seeds 20] [--kinds dust,jpeg] [--csv OUT.csv]

Prints per kind of disturbance and texture, over all seeds: RMS error and median stated uncertainty of the angle (mdeg),
the share of rows whose 95 % interval covers the truth, silent rows (no flag and an error above five stated
uncertainties), rows with a flag, lost rows, rows in all. The films come from `stress_films`, which shares no code with
`vision`. Only moving rows count; the zero is that of the still frames.
"""

from __future__ import annotations

import argparse
import sys
import warnings
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial

import numpy as np
from stress_films import KINDS, STILL, TEXTURES, stress_film

import vision

COLUMNS = "kind,texture,rms_mdeg,u_mdeg,coverage,silent,flagged,lost,rows"


@dataclass(frozen=True)
class Row:
    """Errors and stated uncertainties (mdeg) of the rows found; silent, flagged, lost and all rows."""

    error: np.ndarray
    u: np.ndarray
    silent: int
    flagged: int
    lost: int
    rows: int


def track_one(job: tuple[str, str, int], n_still: int | None = None) -> Row:
    """Render and track one film."""
    film = stress_film(*job)
    source = vision.ArrayFilm(film.frames, frame_rate_hz=2000.0)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            result = vision.track(source, [vision.Body("bar", film.outline_px)], n_still=n_still)
        except vision.VisionInputError as error:
            print(f"{job}: {error}", file=sys.stderr)
            rows = len(film.frames) - STILL
            return Row(np.array([]), np.array([]), 0, 0, rows, rows)
    still = min(result.n_still, STILL)
    error = (result.angle_rad[:, 0] - film.angle_rad + film.angle_rad[:still].mean())[STILL:]
    u, flag = result.u_angle_rad[STILL:, 0], result.flag[STILL:, 0]
    found = np.isfinite(error)
    silent = int(np.sum((flag[found] == 0) & (np.abs(error[found]) > 5.0 * u[found])))
    flagged = int(np.sum(flag[found] != 0))
    scale = 1e3 * 180.0 / np.pi
    return Row(error[found] * scale, u[found] * scale, silent, flagged, int(np.sum(~found)), error.size)


def joined(rows: list[Row]) -> Row:
    """All rows of several films."""
    error, u = (np.concatenate([getattr(row, name) for row in rows]) for name in ("error", "u"))
    return Row(error, u, *(sum(getattr(row, name) for row in rows) for name in ("silent", "flagged", "lost", "rows")))


def line(kind: str, surface: str, row: Row) -> str:
    """One line of the table, comma separated."""
    rms = float(np.sqrt(np.mean(row.error**2))) if row.error.size else float("nan")
    u = float(np.median(row.u)) if row.u.size else float("nan")
    covered = float(np.mean(np.abs(row.error) < 1.96 * row.u)) if row.u.size else float("nan")
    return f"{kind},{surface},{rms:.2f},{u:.2f},{covered:.3f},{row.silent},{row.flagged},{row.lost},{row.rows}"


def main() -> int:
    """Render, track, print; 1 when more than 0.1 % of all rows are silently wrong."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--kinds", default=",".join(KINDS))
    parser.add_argument("--textures", default=",".join(TEXTURES))
    parser.add_argument("--n-still", type=int, default=None)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--csv", default=None, help="also write the table here")
    arguments = parser.parse_args()
    kinds, textures = arguments.kinds.split(","), arguments.textures.split(",")
    lines, everything = [COLUMNS], []
    seeds = range(arguments.first_seed, arguments.first_seed + arguments.seeds)
    with ProcessPoolExecutor(arguments.workers) as pool:
        for kind in kinds:
            for surface in textures:
                jobs = [(kind, surface, seed) for seed in seeds]
                row = joined(list(pool.map(partial(track_one, n_still=arguments.n_still), jobs)))
                everything.append(row)
                lines.append(line(kind, surface, row))
                print(
                    "".join(f"{cell:>17s}" for cell in COLUMNS.split(",")) if len(lines) == 2 else "",
                    end="\n" * (len(lines) == 2),
                )
                print("".join(f"{cell:>17s}" for cell in lines[-1].split(",")), flush=True)
    total = joined(everything)
    lines.append(line("all", "all", total))
    print("".join(f"{cell:>17s}" for cell in lines[-1].split(",")))
    if arguments.csv:
        with open(arguments.csv, "w", encoding="utf-8") as file:
            file.write("\n".join(lines) + "\n")
    return 1 if total.silent > 0.001 * total.rows else 0


if __name__ == "__main__":
    sys.exit(main())
