"""Tracking accuracy and speed on one film per texture: ours against OpenCV's ECC, Lucas-Kanade and template
matching.

    python benchmarks/tracking.py [--frames 600] [--seed 1] [--only wood,speckle,body,films,reading]

Every method gets the same MRAW film (whippen, jack and repetition lever of a blow, 2000 frames/s, motion
blur, 120 Hz flicker, noise of 2 grey levels), the same outlines and the same reference image, and reads the film
from disk itself. Prints per texture: RMS error of the angles (jack and repetition lever relative to the
whippen), its ratio to the Cramer-Rao bound, frames per second for the three bodies together, lost frames. The
last lines check our own figures; the exit code is 1 if one fails. pyIDI's rigid DIC is included if installed.

Then: one body of 10,000 pixels, unoccluded and 30 % occluded, against the Cramer-Rao bound of the visible
pixels; coverage over many films, raw and as MJPEG of quality 95; reading a region against full frames of a large film.

Rates are frames per CPU second with OpenCV on one thread. The truth is the mean of each angle over the
exposure, known by construction. `--frames` below 300 cuts off the blow.
"""

from __future__ import annotations

import argparse
import importlib.util
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import tracking_cases
from filmed_blow import blow
from numpy.typing import NDArray
from tracking_peers import by_lucas_kanade, by_pyidi, by_templates

from rig.simulated import CameraSettings, FilmTruth, film_bodies, film_trial
from vision.angles import picture_to_ccw
from vision.film.open import open_film
from vision.film.source import Film
from vision.fitting.template import Template
from vision.tracking.prepare import prepare
from vision.tracking.track_film import track_film

N_STILL = 64
PARTS = ("wood", "speckle", "body", "films", "reading")
Row = tuple[str, NDArray[np.float64], float, NDArray[np.int64]]


def angles_of(phi: NDArray[np.float64]) -> NDArray[np.float64]:
    """Angles zeroed on the still frames, counter-clockwise, jack and lever relative to the whippen."""
    angle = picture_to_ccw(phi - np.nanmean(phi[:N_STILL], axis=0))
    angle[:, 1:] -= angle[:, :1]
    return angle


def measure(path: Path, truth: FilmTruth, settings: CameraSettings) -> tuple[list[Row], dict[str, float]]:
    """Run all methods on one film; return the rows and our own calibration figures."""
    bodies = film_bodies(settings=settings)
    frame_time_s = truth.frame_time_s
    rows: list[Row] = []
    figures: dict[str, float] = {}
    true = truth.mean_angle_rad - truth.mean_angle_rad[:N_STILL].mean(axis=0)
    for name, method in (("ours, IC-GN with weights", "icgn"), ("OpenCV ECC with mask", "ecc")):
        # compile untimed; the second run reads a film already in the page cache, as for all methods
        track_film(path, bodies, frame_time_s, method=method, every=max(1, len(true) // 4), n_still=N_STILL)
        start = time.process_time()
        result = track_film(path, bodies, frame_time_s, method=method, n_still=N_STILL)
        elapsed = time.process_time() - start
        angle = result.angle_rad.copy()
        angle[:, 1:] -= angle[:, :1]
        rows.append((name, angle - true, len(true) / elapsed, result.failed.sum(axis=0)))
        if method == "icgn":
            u = np.column_stack(
                [result.u_angle_rad[:, 0], result.relative("jack")[1], result.relative("repetition")[1]]
            )
            z = (angle - true) / u
            figures["coverage"], figures["z_std"] = float(np.mean(np.abs(z) < 1.96)), float(np.nanstd(z))
    others: list[tuple[str, Callable[[Film, list[Template], NDArray[np.uint8]], NDArray[np.float64]]]] = [
        ("LK on turned-back frame", by_lucas_kanade),
        ("template match, 2 x 31 px", by_templates),
    ]
    if importlib.util.find_spec("pyidi") is not None:
        others.append(("pyIDI rigid DIC", by_pyidi))
    for name, method_of in others:
        start = time.process_time()
        with open_film(path) as film:
            ready = prepare(film, bodies, N_STILL)
            phi = method_of(film, ready.templates, np.clip(np.rint(ready.reference.picture), 0, 255).astype(np.uint8))
        elapsed = time.process_time() - start
        rows.append((name, angles_of(phi) - true, len(true) / elapsed, np.isnan(phi).sum(axis=0)))
    return rows, figures


def one_body_rows() -> list[str]:
    """Print the results for one body of 10,000 pixels; return failed claims."""
    failures = []
    print("\none body alone, weights on; RMS over the Cramer-Rao bound of the pixels in sight")
    print("  texture    hidden  pixels  RMS mdeg   ratio   cover     z  frames/s  lost")
    for texture, least in (("speckle", 1000.0), ("wood", 600.0)):
        for cover_px in (0, 42):
            row = tracking_cases.one_body(texture, cover_px)
            print(
                f"  {texture:9s}{row['hidden']:8.2f}{row['pixels']:8.0f}{row['rms_mdeg']:10.2f}{row['ratio']:8.3f}"
                f"{row['cover95']:8.3f}{row['z_std']:6.2f}{row['frames_per_s']:10.0f}{row['lost']:6.0f}"
            )
            if row["ratio"] > 1.15 or row["lost"]:
                failures.append(f"one body, {texture}, {row['hidden']:.2f} hidden: ratio at most 1.15, none lost")
            if cover_px == 0 and row["frames_per_s"] < least:
                failures.append(f"one body, {texture}: {least:.0f} frames/s")
        if importlib.util.find_spec("pyidi") is not None:
            row = tracking_cases.against_pyidi(texture)
            # pyIDI's best case: an axis-aligned rectangle, with angles zeroed on the still frames like ours
            print(
                f"  {texture:9s}same rectangle: ours {row['ours']:.2f} mdeg at {row['ours_per_s']:.0f}/s, pyIDI "
                f"{row['pyidi']:.2f} mdeg at {row['pyidi_per_s']:.1f}/s"
            )
    return failures


def film_rows(count: int) -> list[str]:
    """Print coverage over many films, raw and MJPEG; return failed claims."""
    failures = []
    print(f"\n{count} films of three bodies, whippen and relative angles")
    for name, quality in (("raw", None), ("MJPEG q95", 95)):
        coverage, spread, largest, total = tracking_cases.many_films(count, 220, quality)
        print(
            f"  {name:10s}{total} frames: 95 % interval covers {coverage:.3f}, error/uncertainty spreads {spread:.3f}, "
            f"largest error without a flag {largest:.1f} mdeg"
        )
        if not (0.93 <= coverage <= 0.97 and 0.9 <= spread <= 1.1):
            failures.append(f"{name}: coverage 0.93 to 0.97, spread 0.9 to 1.1")
        if largest > 50.0:
            failures.append(f"{name}: no error above 50 mdeg without a flag")
    return failures


def reading_rows() -> list[str]:
    """Print region against full-frame reading; return failed claims."""
    row = tracking_cases.region_reading()
    print(
        f"\nreading 1280 x 1024, 12 bit, warm: full frame {row['full_ms']:.2f} ms ({row['frame_bytes']:.0f} bytes), "
        f"220 x 220 {row['region_ms']:.3f} ms ({row['region_bytes']:.0f} bytes of pixels in rows of "
        f"{row['row_bytes']:.0f} bytes): {row['times_faster']:.0f} times faster"
    )
    return [] if row["times_faster"] >= 10.0 and row["same"] else ["region at least 10 times faster, and the same"]


def main() -> int:
    """Film, track, print, check."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--frames", type=int, default=600)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--films", type=int, default=24, help="films for the coverage rows")
    parser.add_argument("--only", default=",".join(PARTS), help="parts to run, of " + ",".join(PARTS))
    arguments = parser.parse_args()
    only = arguments.only.split(",")
    cv2.setNumThreads(1)
    failures = []
    for texture in (texture for texture in ("wood", "speckle") if texture in only):
        settings = CameraSettings(texture=texture)
        times = 62.5e-6 + np.arange(arguments.frames) / settings.frame_rate_hz
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "film.mraw"
            start = time.process_time()
            truth = film_trial(path, times, blow, settings=settings, seed=arguments.seed)
            rendering = arguments.frames / (time.process_time() - start)
            bound = np.degrees(truth.relative_crlb_rad) * 1e3
            size = f"{settings.width} x {settings.height}"
            print(f"\n{texture}: {arguments.frames} frames {size}, rendered at {rendering:.0f}/s")
            bounds = f"whippen {bound[0]:.2f}, jack-whippen {bound[1]:.2f}, lever-whippen {bound[2]:.2f}"
            print(f"  Cramer-Rao bound, mdeg: {bounds}")
            print(f"  {'method':27s} {'RMS, mdeg (ratio to the bound)':^52s} {'frames/s':>8s}  lost")
            rows, figures = measure(path, truth, settings)
        for name, error, rate, lost in rows:
            rms = np.degrees(np.sqrt(np.nanmean(error**2, axis=0))) * 1e3
            cells = "".join(f"{value:9.2f} ({value / b:6.2f})" for value, b in zip(rms, bound, strict=True))
            print(f"  {name:27s}{cells} {rate:8.0f}  {lost.tolist()}")
        print(
            f"  ours: 95 % interval covers {figures['coverage']:.3f}, error/uncertainty spreads {figures['z_std']:.3f}"
        )
        _, error, rate, lost = rows[0]
        ratio = np.sqrt(np.mean(error**2, axis=0)) / truth.relative_crlb_rad
        checks = {
            "no frame lost": bool(lost.sum() == 0),
            "every angle within 1.15 of the bound": bool(np.all(ratio <= 1.15)),
            "no angle better than the bound allows": bool(np.all(ratio >= 0.9)),
            "95 % interval covers .92 to .98": 0.92 <= figures["coverage"] <= 0.98,
            "at least 400 frames/s for three bodies": rate >= 400.0,
            "no other method is more accurate": all(
                np.nanmean(other[1][:, 1] ** 2) > 0.98 * np.mean(error[:, 1] ** 2) for other in rows[1:]
            ),
        }
        for other in rows[1:]:
            if other[0].startswith("pyIDI"):
                gain = np.sqrt(np.nanmean(other[1][:, 1] ** 2) / np.mean(error[:, 1] ** 2))
                checks["1.5 times more accurate and 50 times faster than pyIDI"] = bool(
                    gain >= 1.5 and rate >= 50.0 * other[2]
                )
        failures += [f"{texture}: {claim}" for claim, holds in checks.items() if not holds]
        print("  " + "; ".join(f"{claim}: {'yes' if holds else 'NO'}" for claim, holds in checks.items()))
    failures += one_body_rows() if "body" in only else []
    failures += film_rows(arguments.films) if "films" in only else []
    failures += reading_rows() if "reading" in only else []
    for failure in failures:
        print(f"FAILED {failure}", file=sys.stderr)
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
