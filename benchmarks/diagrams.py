"""One diagram for each job: time against error or against size, beside peers, and the floor.

Processor time; who is no peer here or is not installed is left out. With ``--results FILE`` a job is done once.
"""

from __future__ import annotations

import re
import tempfile
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace
from typing import NamedTuple

import cv2
import numpy as np

import model
from benchmarks import floor, report, tracking
from benchmarks.batches import TOLERANCE, trials
from benchmarks.identification_coverage import one as one_fit
from benchmarks.peers.compiled import CompiledEquations, CompiledJacobian, force_table, pack
from benchmarks.peers.solvers import Task, Unavailable
from benchmarks.runner import Run, least
from benchmarks.sensitivities import sixty
from benchmarks.work_precision import OUR_TOLERANCES, PEERS, Entry, our_solver, race
from model.integrators.methods import DEFAULT_METHOD
from vision.film.open import open_film

Lines = dict[str, tuple[list[float], list[float]]]
"""x and y of each line by its name; those that begin with ``floor`` are drawn as such, ``ours`` thick."""


class Job(NamedTuple):
    """A diagram: what lies along its axes, and what makes its lines."""

    x: str
    y: str
    made: Callable[[], Lines]


def a_blow() -> Lines:
    """A forte of 0.7 s: largest error of an angle, rad; ms."""
    action, (t, f) = model.load_action(), force_table("forte")
    rest, at = model.rest_state(action), np.ascontiguousarray(t[::5])
    equations, start = CompiledEquations(action), np.concatenate([rest.angle_rad, np.zeros(5)])
    task = Task(action, equations, CompiledJacobian(action), t, f, pack(t, f), start, at)
    exact = our_solver(task, rest, "rodas5p")(1e-12).angle_rad
    entries = [Entry("ours", True, our_solver(task, rest, DEFAULT_METHOD), OUR_TOLERANCES)]
    for name in ("CVODE from C", "CVODE from C with analytic J", "scikit-sundae CVODE", "SciPy odeint (LSODA)"):
        with suppress(Unavailable):
            entries.append(Entry(name, False, PEERS[name][0](task), PEERS[name][1]))
    rows = race("forte", entries, exact, 5, print)
    out: Lines = {}
    for row in rows:
        x, y = out.setdefault(row.method, ([], []))
        x.append(row.error_rad)
        y.append(1e3 * row.best_s)
    found = floor.attempts("forte", 1e-5, 5)
    for name in ("waiting", "units"):
        share = found[name] / found["run"]
        out[f"floor, {name}"] = out["ours"][0], [share * ms for ms in out["ours"][1]]
    return out


def a_batch() -> Lines:
    """Fortes at 1e-4 rad on one core: members; ms a member."""
    action, out = model.load_action(), Lines()
    for name, lanes, most in (("ours, one by one", False, 64), ("ours, in lanes", True, 1024)):
        sizes = [n for n in (1, 4, 16, 64, 256, 1024) if n <= most]
        spent = [
            least(lambda n=n, lanes=lanes: model.simulate_many(
                action, trials(n), tolerance=TOLERANCE, workers=1, lanes=lanes
            )) for n in sizes
        ]  # fmt: skip
        out[name] = [float(n) for n in sizes], [1e3 * s / n for s, n in zip(spent, sizes, strict=True)]
    found = floor.attempts("forte", TOLERANCE, 5)
    for name in ("units", "lanes"):
        out[f"floor, {name}"] = [1.0, 1024.0], [1e-3 * found["attempts"] * found[name]] * 2
    return out


def derivatives() -> Lines:
    """Of a forte: parameters; ms."""
    action, blow, sizes = model.load_action(), model.force_table("forte"), (1, 3, 10, 30, 60)
    names, run = sixty(action), 1e3 * least(lambda: model.simulate(action, *blow), 5)
    ours = [1e3 * least(lambda n=n: model.sensitivities(action, blow, names[:n])) for n in sizes]
    x = [float(n) for n in sizes]
    return {"ours": (x, ours), "central differences": (x, [2.0 * n * run for n in x]), "floor, one run": (x, [run] * 5)}


def a_fit() -> Lines:
    """Of two forte trials: parameters; s."""
    options = SimpleNamespace(seed=1, kinds=["forte"], scene="", profiles=False)
    rows = [one_fit(n, 2, options) for n in (1, 3, 6, 12)]  # type: ignore[arg-type]
    x = [float(row["free"]) for row in rows]
    model_s = [row["derivatives"] + row["runs"] for row in rows]
    return {"ours": (x, [row["fit"] for row in rows]), "floor, the model's runs": (x, model_s)}


def a_film() -> Lines:
    """Three bodies, 600 frames with speckle: RMS error of the jack, mdeg; ms a frame."""
    cv2.setNumThreads(1)
    with tracking.filmed("speckle", 600) as (path, truth, settings):
        rows, _ = tracking.measure(path, truth, settings)

        def read() -> None:
            with open_film(path) as film:
                for k in range(film.n_frames):
                    film.read(k).max()

        reading = 1e3 * least(read) / 600
    rms = [float(np.degrees(np.sqrt(np.nanmean(error[:, 1] ** 2))) * 1e3) for _, error, *_ in rows]
    bound, slowest = float(np.degrees(truth.relative_crlb_rad[1]) * 1e3), max(1e3 / rate for *_, rate, _ in rows)
    out = {name: ([x], [1e3 / rate]) for (name, _, rate, _), x in zip(rows, rms, strict=True)}
    return out | {
        "floor, Cramér-Rao": ([bound, bound], [reading, slowest]), "floor, reading": ([bound, max(rms)], [reading] * 2)
    }  # fmt: skip


def a_report() -> Lines:
    """Of a session of forte trials, new process: trials; s."""
    sizes, out = (1, 3, 10, 30, 100), Lines()
    with tempfile.TemporaryDirectory() as place:
        report.validate(report.make_session(Path(place) / "first", 2))
        folders = [report.make_session(Path(place) / f"s{n}", n) for n in sizes]
        for name in ("ours", "floor, nothing new"):
            out[name] = [float(n) for n in sizes], [report.validate(folder)["cpu_s"] for folder in folders]
    return out


JOBS = {
    "blow": Job("largest error of an angle, rad", "ms", a_blow), "batch": Job("members", "ms a member", a_batch),
    "derivatives": Job("parameters", "ms", derivatives), "fit": Job("parameters, two trials", "s", a_fit),
    "film": Job("RMS error of the jack, mdeg", "ms a frame, three bodies", a_film),
    "report": Job("trials", "s", a_report),
}  # fmt: skip
PEER = ("#D55E00", "#CC79A7", "#E69F00", "#56B4E9", "#009E73")
MARKS = "s^vDx"


def draw(jobs: dict[str, Lines], path: Path) -> None:
    """Write the diagrams side by side."""
    import matplotlib

    matplotlib.use("Agg")
    matplotlib.rcParams.update({"svg.fonttype": "none", "svg.hashsalt": "diagrams", "font.size": 9})
    import matplotlib.pyplot as plt
    from matplotlib.ticker import FuncFormatter, LogLocator

    figure, axes = plt.subplots(-(-len(jobs) // 2), 2, figsize=(9.0, 3.6 * -(-len(jobs) // 2)), squeeze=False)
    for panel, (job, lines) in zip(axes.flat, jobs.items(), strict=False):
        panel.set(xscale="log", yscale="log", xlabel=JOBS[job].x, ylabel=JOBS[job].y)
        panel.set_title(job, loc="left", fontweight="bold")
        peers = [name for name in lines if not name.startswith(("ours", "floor"))]
        for k, name in enumerate(lines):
            x, y = lines[name]
            if name.startswith("floor"):
                style = {"color": "#777777", "ls": ":" if k % 2 else "-.", "lw": 1.4}
            elif name.startswith("ours"):
                style = {"color": "#0072B2" if k == 0 else "#000000", "marker": "o", "lw": 2.0, "ms": 5}
            else:
                at = peers.index(name) % len(PEER)
                style = {"color": PEER[at], "marker": MARKS[at], "mfc": "none", "lw": 1.0, "ls": "--", "ms": 5}
            panel.plot(x, y, label=name, **style)
        if job == "blow":
            panel.invert_xaxis()
        for axis, ends in ((panel.xaxis, panel.get_xlim()), (panel.yaxis, panel.get_ylim())):
            few = abs(np.log10(ends[1] / ends[0])) < 3.5
            axis.set_major_locator(LogLocator(subs=(1.0, 3.0) if few else (1.0,), numticks=9))
            if few:
                axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        panel.minorticks_off()
        panel.grid(True, color="#dddddd", lw=0.6)
        low, high = panel.get_ylim()
        names = 0.05 + 0.06 * len(lines)  # their share of the height
        panel.set_ylim(low, high * (high / low) ** (names / (1.0 - names)))
        panel.legend(frameon=False, fontsize=8, loc="upper left", labelspacing=0.25, handlelength=2.6)
    for panel in list(axes.flat)[len(jobs) :]:
        panel.set_axis_off()
    figure.tight_layout()
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, metadata={"Date": None} if path.suffix == ".svg" else None, dpi=110)
    plt.close(figure)
    if path.suffix == ".svg":  # a hundredth of a point is enough and halves the file size
        text = path.read_text(encoding="utf-8")
        short = re.sub(r"\d+\.\d{3,}", lambda number: f"{float(number[0]):.2f}".rstrip("0").rstrip("."), text)
        path.write_text(short, encoding="utf-8")


def main(run: Run) -> bool:
    """Measure, print and draw; whether no line of ours lies below a floor of its diagram."""
    jobs = {job: lines for (job,), lines in run.cases([(job,) for job in run.only], lambda job: JOBS[job].made())}
    for job, lines in jobs.items():
        print(f"\n{job}: {JOBS[job].x}; {JOBS[job].y}")
        for name, (x, y) in lines.items():
            print(f"  {name:32s}" + "  ".join(f"{a:.3g}: {b:.3g}" for a, b in zip(x, y, strict=True)))
    if run.out and not run.left:
        draw(jobs, Path(run.out))
        print(f"diagram: {run.out}")
    return all(
        min(ours[1]) >= 0.9 * min(lines[name][1])
        for lines in jobs.values() for label, ours in lines.items() if label.startswith("ours")
        for name in lines if name in ("floor, lanes", "floor, one run", "floor, units", "floor, reading")
        and not (label == "ours, in lanes" and name == "floor, units")
    )  # fmt: skip
