"""Disturbed films: how far off the tracker is, what it says about it, and what it loses.

    python benchmarks/tracking_stress.py [--seeds 20] [--kinds dust,jpeg] [--csv OUT.csv]
    python benchmarks/tracking_stress.py --seeds 20 --keep stress.jsonl --minutes 5     # again until it is whole

Prints per kind of disturbance and texture, over all seeds: RMS error and median stated uncertainty of the angle (mdeg),
the share of rows whose 95 % interval covers the truth, silent rows (no flag, or ``WIDENED`` alone, and an error above
five stated uncertainties), rows with any other flag, lost rows, rows in all; flagged and lost rows of films that
``permit`` tracking, whose bound (least error that the film's noise permits) is at most a quarter of 0.05 degrees; rows
that are only ``WIDENED``, which count as usable. The films come from `stress_films`, which shares no code with
`vision`. Only moving rows count; the zero is that of the still frames. With ``--keep`` each film's rows are kept, and
a run goes on where another stopped. H.264 needs PyAV (``pip install av``).
"""

from __future__ import annotations

import argparse
import json
import sys
import time
import warnings
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from stress_films import KINDS, STILL, TEXTURES, stress_film

import vision
from vision.results.flags import FrameFlag

COLUMNS = "kind,texture,rms_mdeg,u_mdeg,coverage,silent,flagged,lost,rows,permit_bad,permit_rows,widened"
PERMITS_MDEG = 12.5
Job = tuple[str, str, int]


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


def track_one(job: Job, n_still: int | None = None) -> Row:
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


def line(kind: str, surface: str, row: Row) -> str:
    """One line of the table, comma separated."""
    error, us = np.array(row.error), np.array(row.u)
    rms = float(np.sqrt(np.mean(error**2))) if error.size else float("nan")
    u = float(np.median(us)) if us.size else float("nan")
    covered = float(np.mean(np.abs(error) < 1.96 * us)) if us.size else float("nan")
    counts = f"{row.silent},{row.flagged},{row.lost},{row.rows},{row.permit_bad},{row.permit_rows},{row.widened}"
    return f"{kind},{surface},{rms:.2f},{u:.2f},{covered:.3f},{counts}"


def kept(path: Path | None) -> dict[Job, Row]:
    """Rows of films tracked before."""
    if path is None or not path.exists():
        return {}
    lines = [json.loads(text) for text in path.read_text(encoding="utf-8").splitlines()]
    return {(one["kind"], one["texture"], one["seed"]): Row(**one["row"]) for one in lines}


def main() -> int:
    """Render, track, print; 1 when more than 0.1 % of all rows are silently wrong, 3 when films are left to track."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--kinds", default=",".join(KINDS))
    parser.add_argument("--textures", default=",".join(TEXTURES))
    parser.add_argument("--n-still", type=int, default=None)
    parser.add_argument("--keep", type=Path, default=None, help="file of the films done, one line each; resumed from")
    parser.add_argument("--minutes", type=float, default=np.inf, help="stop after so many")
    parser.add_argument("--csv", type=Path, default=None, help="also write the table here")
    arguments = parser.parse_args()
    kinds, textures = arguments.kinds.split(","), arguments.textures.split(",")
    if "h264" not in KINDS:
        print("H.264 is left out: PyAV is not installed (pip install av)", file=sys.stderr)
    seeds = range(arguments.first_seed, arguments.first_seed + arguments.seeds)
    end, done, left = time.monotonic() + 60.0 * arguments.minutes, kept(arguments.keep), 0
    for job in [(kind, surface, seed) for seed in seeds for kind in kinds for surface in textures]:
        if job in done:
            continue
        if time.monotonic() > end:
            left += 1
            continue
        done[job] = track_one(job, arguments.n_still)
        if arguments.keep is not None:
            record = {"kind": job[0], "texture": job[1], "seed": job[2], "row": asdict(done[job])}
            with arguments.keep.open("a", encoding="utf-8") as file:
                file.write(json.dumps(record) + "\n")
    lines, everything = [COLUMNS], []
    for kind in kinds:
        for surface in textures:
            rows = [done[kind, surface, seed] for seed in seeds if (kind, surface, seed) in done]
            if rows:
                everything += rows
                lines.append(line(kind, surface, joined(rows)))
    total = joined(everything)
    lines.append(line("all", "all", total))
    for text in lines:
        print("".join(f"{cell:>19s}" if k < 2 else f"{cell:>12s}" for k, cell in enumerate(text.split(","))))
    if arguments.csv:
        arguments.csv.write_text("\n".join(lines) + "\n", encoding="utf-8")
    if left:
        print(f"{left} films left: run the same command again", file=sys.stderr)
        return 3
    return 1 if total.silent > 0.001 * total.rows else 0


if __name__ == "__main__":
    sys.exit(main())
