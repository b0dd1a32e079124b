"""A real film against another program: poses lost, difference from DICe's angles, stated uncertainty, flags.

    python benchmarks/real_film.py [FOLDER]        # default: ../shared/data/escapement beside the repository

FOLDER holds the pictures of an escapement (DICe's regression test), ``bodies.toml`` and DICe's results ``gold_K.csv``
of its K-th body. No true angle is known: both programs see the same pixels, so that what misleads both does not show.
DICe states a standard deviation of its shifts (``SIGMA``, px) and none of its angles. Without the folder nothing is
done.
"""

from __future__ import annotations

import argparse
import csv
import sys
import warnings
from pathlib import Path

import numpy as np

import vision

BESIDE = Path(__file__).resolve().parents[2] / "shared" / "data" / "escapement"


def main() -> int:
    """Track and print one line per body; 1 where a pose is lost."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("folder", type=Path, nargs="?", default=BESIDE)
    folder = parser.parse_args().folder
    if not (folder / "bodies.toml").is_file():
        print(f"skipped: {folder} is not there (pictures, bodies.toml and gold_*.csv of DICe's escapement)")
        return 0
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", vision.VisionWarning)  # no frame is still
        with vision.open_film(folder) as film:
            times = np.arange(film.n_frames) / 1000.0
            result = vision.track(film, vision.load_bodies(folder / "bodies.toml"), times)
    heads = ("body", "poses", "lost", "flagged", "RMS mrad", "u mrad", "covered", "DICe SIGMA px")
    print("".join(f"{head:>15}" for head in heads))
    for i, body in enumerate(result.bodies):
        with (folder / f"gold_{i}.csv").open(encoding="utf-8") as file:
            rows = list(csv.DictReader(file))
        n = min(len(rows), len(result.frame))
        # DICe's angles are in the picture's sense; the first frame is the reference of both
        theirs = -np.array([float(row["ROTATION_Z"]) for row in rows[:n]])
        off, u = (result.angle_rad[:n, i] - theirs)[1:], result.u_angle_rad[1:n, i]
        found = np.isfinite(off)
        covered = float(np.mean(np.abs(off[found]) < 1.96 * u[found]))
        sigma = float(np.median([float(row["SIGMA"]) for row in rows[:n]]))
        flagged = int(np.count_nonzero(result.flag[:, i][~result.failed[:, i]]))
        lost, rms, median = int(result.failed[:, i].sum()), np.sqrt(np.mean(off[found] ** 2)), np.median(u[found])
        figures = (len(result.frame), lost, flagged, f"{1e3 * rms:.2f}", f"{1e3 * median:.2f}", f"{covered:.2f}", sigma)
        print("".join(f"{cell:>15}" for cell in (body, *figures)))
    return int(result.failed.any())


if __name__ == "__main__":
    sys.exit(main())
