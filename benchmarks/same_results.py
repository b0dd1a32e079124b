"""Do two checkouts give the same results? Every scene with every method, and the reports of the shipped sessions.

Each job runs ``pianorig`` in a separate process, once from each checkout. Columns of angles, speeds and forces are
compared numerically: the largest difference of any angle in rad, and of any other column relative to its largest
value. ``results.json`` and ``report.html`` are compared value by value and line by line, after masking hashes, dates,
run times, versions and paths. Right: angles within 1e-13 rad and all else identical.
"""

from __future__ import annotations

import difflib
import json
import re
import shutil
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from benchmarks.runner import ROOT, Checkout, Run, checkouts

SCENES = (
    "whole",
    "without-string",
    "key",
    "key-whippen",
    "lifting-key",
    "flexible-shank",
    "lifting-key-flexible-shank",
    "motor-arm",
)
LARGEST_ANGLE_DIFFERENCE = 1e-13
MASKS = (
    (re.compile(r"\b[0-9a-f]{16,64}\b"), "HASH"),
    (re.compile(r"\d{4}-\d\d-\d\d[T ]\d\d:\d\d(:\d\d)?(\.\d+)?(Z|\+00:00)?( UTC)?"), "DATE"),
    (re.compile(r"\d+(\.\d+)? (ms|s) of computing|in \d+(\.\d+)? s\b"), "DURATION"),
    (re.compile(r"/tmp/[\w./-]+"), "PATH"),
)
UNSTABLE_KEYS = re.compile(r"sha256|hash|version|created|date|elapsed|seconds|wall_time|path|origin|reused")


def pianorig(checkout: Checkout, *arguments: str | Path) -> None:
    """Run one command from the source of ``checkout``."""
    code = "import sys; from pianorig.cli import main; main(sys.argv[1:])"
    checkout.run("-c", code, *arguments, SOURCE_DATE_EPOCH="0")


def input_tables(folder: Path) -> dict[str, Path]:
    """A forte's force, and a torque of the motor's arm, as CSV."""
    paths = {"force": ROOT / "tests/model/data/forte_force.csv", "torque": folder / "torque.csv"}
    table = pd.read_csv(paths["force"])
    table = table.assign(torque_nm=(0.05 * table.pop("force_n")).round(5))
    table.to_csv(paths["torque"], index=False)
    return paths


def compare_columns(a: Path, b: Path) -> tuple[float, float]:
    """Largest difference of an angle (rad), and of any other column relative to its largest value."""
    left, right = pd.read_csv(a, comment="#"), pd.read_csv(b, comment="#")
    if list(left) != list(right) or len(left) != len(right):
        raise SystemExit(f"{a.name}: columns or rows differ: {list(left)} {len(left)}, {list(right)} {len(right)}")
    angle = other = 0.0
    for name in left:
        x, y = left[name].to_numpy(float), right[name].to_numpy(float)
        if not np.array_equal(np.isnan(x), np.isnan(y)):
            raise SystemExit(f"{a.name}: {name}: NaN in different rows")
        difference = float(np.nanmax(np.abs(x - y), initial=0.0))
        if name.endswith("_rad"):
            angle = max(angle, difference)
        else:
            other = max(other, difference / max(float(np.nanmax(np.abs(x), initial=0.0)), 1e-300))
    return angle, other


def masked(text: str, checkout: Path, folder: Path) -> str:
    """Mask text that may differ between two runs of the same computation."""
    for place in (str(checkout), str(folder)):
        text = text.replace(place, "PLACE")
    for pattern, word in MASKS:
        text = pattern.sub(word, text)
    return text


def stable(value: Any, checkout: Path, folder: Path) -> Any:
    """Return a JSON value without its unstable keys, with text masked."""
    if isinstance(value, dict):
        return {k: stable(v, checkout, folder) for k, v in value.items() if not UNSTABLE_KEYS.search(k)}
    if isinstance(value, list):
        return [stable(v, checkout, folder) for v in value]
    return masked(value, checkout, folder) if isinstance(value, str) else value


def differences(a: Any, b: Any, where: str = "") -> list[str]:
    """List where two JSON values differ."""
    if isinstance(a, dict) and isinstance(b, dict):
        keys = sorted({*a, *b})
        return [line for k in keys for line in differences(a.get(k), b.get(k), f"{where}/{k}")]
    if isinstance(a, list) and isinstance(b, list) and len(a) == len(b):
        return [line for i, pair in enumerate(zip(a, b, strict=True)) for line in differences(*pair, f"{where}/{i}")]
    return [] if a == b or (a != a and b != b) else [f"{where}: {str(a)[:80]!r} became {str(b)[:80]!r}"]


def compare_simulations(both: tuple[Checkout, Checkout], run: Run, folder: Path) -> bool:
    """Compare every scene with every method; print a row for each."""
    tables, fine = input_tables(folder), True
    for scene in run.scenes or SCENES:
        table = tables["torque" if scene == "motor-arm" else "force"]
        for method in run.methods:
            out = [folder / f"{scene}_{method}_{side}.csv" for side in "ab"]
            for checkout, path in zip(both, out, strict=True):
                options = ["--scene", scene, "--method", method, "--forces", "--inside"]
                pianorig(checkout, "simulate", "--force", table, *options, "--out", path)
            angle, rest = compare_columns(*out)
            same = angle <= LARGEST_ANGLE_DIFFERENCE and rest == 0.0
            fine &= same
            print(f"{scene:28} {method:8} angle {angle:.1e} rad, other columns {rest:.1e}{'' if same else '  DIFFERS'}")
    return fine


def compare_reports(both: tuple[Checkout, Checkout], names: list[str], folder: Path) -> bool:
    """Compare the reports of the shipped sessions; print the differences."""
    fine = True
    for name in names:
        found: list[tuple[Any, list[str]]] = []
        for side, checkout in zip("ab", both, strict=True):
            session = folder / side / name
            shutil.copytree(ROOT / "sessions" / name, session, ignore=shutil.ignore_patterns("derived"))
            report = folder / side / f"report_{name}"
            pianorig(checkout, "validate", session, "--out", report)
            here = folder / side
            results = stable(json.loads((report / "results.json").read_text("utf-8")), checkout.root, here)
            page = masked((report / "report.html").read_text("utf-8"), checkout.root, here)
            found.append((results, page.splitlines()))
        lines = differences(found[0][0], found[1][0])
        changed = [d for d in difflib.unified_diff(found[0][1], found[1][1], lineterm="", n=0) if d[:1] in "+-"]
        fine &= not lines and not changed
        print(f"{name}: results.json {len(lines)} differences, report.html {len(changed)} lines")
        for line in [*lines[:20], *(text[:160] for text in changed[:20])]:
            print("   ", line)
    return fine


def main(run: Run) -> bool:
    """Compare this checkout with another one."""
    both = checkouts(run)
    with tempfile.TemporaryDirectory() as folder:
        fine = compare_simulations(both, run, Path(folder))
        fine &= compare_reports(both, run.sessions, Path(folder))
    print("the same" if fine else "NOT the same")
    return fine
