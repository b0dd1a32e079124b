"""``pianorig demo``: the main job from end to end on the virtual bench: record, film, track, simulate, report."""

from __future__ import annotations

import importlib
import math
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from threading import Thread
from typing import TYPE_CHECKING, Annotated, Any

import typer

import model
import validation
from model.tolerance import DEFAULT_TOLERANCE
from pianorig import workflows
from pianorig.console.failures import Interrupted, how_stopped
from pianorig.console.options import AsJson, Profile
from pianorig.console.output import paragraphs, table_lines, tell
from pianorig.console.progress import bar, recording_line, say, working

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    import rig
    import vision
    from rig.simulated import FilmTruth

FILMED = 1
# what tracking, comparison and report import, 2 s; nothing of ours: kernels are decorated on one thread at a time,
# because where numba keeps them is a setting of the process
FOLLOWS = (
    "pandas",
    "scipy.optimize",
    "scipy.interpolate",
    "scipy.ndimage",
    "scipy.spatial",
    "jinja2",
)


def command(
    out: Annotated[
        Path | None, typer.Option("--out", help="Session folder to create; default: sessions/<date>_demo.")
    ] = None,
    profile: Profile = "forte",
    trials: Annotated[int, typer.Option("--trials", help="Number of trials.")] = 5,  # choice
    as_json: AsJson = False,
) -> None:
    """Record five virtual blows, film and track one, report.
    Everything goes into a new session folder; how fast and how exact it was is printed.

    Example:  pianorig demo --out sessions/demo
    """
    target = out or workflows.new_session_folder("demo")
    demo = run_demo(target, trials=trials, profile=profile, quiet=as_json)
    # start-up: 1 s of pandas
    from rig.atomic_write import write_text
    from validation.report.figures.five_angles import angles_svg
    from validation.side_by_side import present_alone

    report, picture = demo.result.files["report.html"], demo.session.path / "angles.svg"
    write_text(picture, angles_svg([demo.result]))
    facts = {"session": demo.session.path, "report": report, "picture": picture, "verdict": demo.result.verdict}
    lines = [
        *paragraphs(describe_demo(demo)),
        "",
        *figure_lines(demo.figures),
        "",
        *workflows.comparison_lines(present_alone(demo.result)),
        "",
        "next:",
        *(f"  {line}\n      {what}" for line, what in next_commands(demo.session.path)),
        f"report: {report}",
        f"picture: {picture}",
    ]
    tell(as_json, facts | demo.figures.facts(), lines)


def _import_what_follows() -> None:
    for name in FOLLOWS:
        importlib.import_module(name)


@dataclass(frozen=True)
class TrackingError:
    """Error of one tracked relative angle against the film's truth, rad, and its Cramer-Rao bound."""

    body: str
    rms_rad: float
    bound_rad: float
    stated_u_rad: float
    lost: int

    @property
    def ratio(self) -> float:
        """RMS error over the bound."""
        return self.rms_rad / self.bound_rad


@dataclass(frozen=True)
class Figures:
    """What the demo measured of itself."""

    tracking: tuple[TrackingError, ...]
    tracking_frames_per_s: float
    simulation_s: float
    simulation_error_rad: float
    simulation_steps: int
    seconds: dict[str, float]
    peak_memory_mib: float | None

    def facts(self) -> dict[str, Any]:
        """The measured figures by name with units in it (ms, rad, frames/s, s, MiB), as plain data; ``seconds`` by
        stage, the tracking error over its bound by body."""
        return {
            "simulation_ms": self.simulation_s * 1e3,
            "simulation_error_rad": self.simulation_error_rad,
            "tracking_frames_per_s": self.tracking_frames_per_s,
            "tracking_ratio_to_bound": {t.body: t.ratio for t in self.tracking},
            "seconds": self.seconds,
            "peak_memory_mib": self.peak_memory_mib,
        }


@dataclass(frozen=True)
class Demo:
    session: rig.Session
    film: FilmTruth
    track: vision.TrackResult
    result: validation.ValidationResult
    figures: Figures


def tracking_errors(result: vision.TrackResult, truth: FilmTruth) -> tuple[TrackingError, ...]:
    """For jack and repetition lever: RMS error of the tracked angle relative to its parent against the film's true one
    (rad), the lower bound, the stated uncertainty, and the number of frames lost."""
    import numpy as np  # start-up: 0.1 s that --help does not need

    out = []
    rows = result.frame
    for body in ("jack", "repetition"):
        angle, u, _ = result.relative(body)
        column = truth.bodies.index(body)
        true = truth.mean_angle_rad[rows, column]
        error = angle - (true - true[rows < result.n_still].mean())
        good = np.isfinite(error)
        out.append(
            TrackingError(
                body,
                float(np.sqrt(np.mean(error[good] ** 2))) if good.any() else float("nan"),
                float(truth.relative_crlb_rad[column]),
                float(np.median(u[good])) if good.any() else float("nan"),
                int((~good).sum()),
            )
        )
    return tuple(out)


def measure_simulation(
    time_s: NDArray[np.float64], force_n: NDArray[np.float64], tolerance: float = DEFAULT_TOLERANCE
) -> tuple[float, float, int]:
    """Simulate the built-in action under a force (n,), N, at times (n,), s; return the best of five run times (s), the
    largest error of an angle against a run at 1e-9 (rad), and the number of steps."""
    action = model.load_action()
    fine = model.simulate(action, time_s, force_n, tolerance=1e-9)
    best = float("inf")
    for _ in range(5):
        start = time.perf_counter()
        solution = model.simulate(action, time_s, force_n, tolerance=tolerance)
        best = min(best, time.perf_counter() - start)
    error = float(abs(solution.angle_rad - fine.angle_rad).max())
    return best, error, int(solution.counters["n_steps"])


def peak_memory_mib() -> float | None:
    """Largest resident memory of this process so far, MiB; None where the system does not report it."""
    try:
        import resource  # platform: POSIX only
    except ImportError:
        return None
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / 1024**2 if sys.platform == "darwin" else peak / 1024


def run_demo(out: Path, *, trials: int, profile: str = "forte", quiet: bool = True) -> Demo:
    """Record ``trials`` blows on the virtual bench into the new folder ``out``, film and track the first, compare all
    with the model and write the report; return all results with measured speed, errors and memory."""
    # on a first run the bench's own scene compiles here, and what comes after it on the other processor
    whole = model.load_scene("whole")
    beside = model.compile_ahead([whole], loop=True, then="pianorig.workflows.first_run:call_once")
    seconds: dict[str, float] = {}

    @contextmanager
    def stage(name: str, text: str) -> Iterator[None]:
        say(text, quiet)
        start = time.perf_counter()
        yield
        seconds[name] = time.perf_counter() - start

    # compiled code draws the film meanwhile, which leaves Python to others
    Thread(target=_import_what_follows, daemon=True).start()
    words = f"recording {trials} {profile} blows on the virtual bench, filming trial {FILMED}"
    with (
        stage("record and film", words),
        workflows.report_interrupt(out),
        bar("filming", quiet) as filming,
        recording_line(quiet) as recording,
    ):
        session, films = workflows.record(
            out,
            profile=profile,
            trials=trials,
            film=(FILMED,),
            operator="pianorig demo",
            action_name="virtual specimen (rig/simulated/bench.toml)",
            progress=recording,
            film_progress=filming,
        )
    film = session.trial(FILMED).film
    if film is None:
        raise RuntimeError("the demo's film was not written")
    with _name_session_on_interrupt(out):
        if beside is not None:
            with stage("compile", "compiling what the comparison needs"):
                model.compile_lanes(whole)
                beside.wait()  # for what tracking needs: compiled here as well it would take longer
        with stage("track", f"tracking {film.name}"), bar("tracking", quiet) as tracking:
            track = workflows.track_film_file(workflows.SessionFilm(film), progress=tracking)
        with stage("validate", "comparing with the model"), working("comparing", quiet) as words_of:
            result = validation.validate_session(session, "hirschkorn2004", progress=words_of, effects=False)
        with (
            stage("measure the simulation", "measuring speed and error of one simulation"),
            working("simulating", quiet),
        ):
            trace = result.traces[FILMED]
            trace = trace[trace["force_time_s"].between(0.3, 1.0)]  # 0.7 s around the blow
            simulation = measure_simulation(trace["force_time_s"].to_numpy(), trace["force_n"].to_numpy())
    errors, frames_per_s = tracking_errors(track, films[FILMED]), len(track.frame) / seconds["track"]
    figures = Figures(errors, frames_per_s, *simulation, seconds, peak_memory_mib())
    return Demo(session, films[FILMED], track, result, figures)


@contextmanager
def _name_session_on_interrupt(folder: Path) -> Iterator[None]:
    """Context in which Ctrl-C raises `Interrupted`, whose message names the session's folder, says that its trials are
    sealed, and gives the command that goes on."""
    try:
        yield
    except KeyboardInterrupt as interrupt:
        raise Interrupted(
            f"{how_stopped(interrupt)}; nothing was moving; every trial is sealed; session at {folder}; go on with  "
            f"pianorig validate {folder}"
        ) from interrupt


def describe_demo(demo: Demo) -> list[str]:
    """Three paragraphs for the terminal: what the demo recorded and tracked, how the model was compared, what the
    report shows."""
    trials = len(demo.session.trials)
    lost = sum(error.lost for error in demo.figures.tracking)
    return [
        f"The motor of a virtual bench struck the key of a piano action {trials} times. Force and the angles of key, "
        f"whippen and hammer were recorded; the first blow was also filmed, and jack and repetition lever were tracked "
        f"in {len(demo.track.frame)} frames, {lost or 'none'} of them lost.",
        "The model was then driven with each blow's own force and its motion held against the measured one. The "
        "virtual action differs from the model on purpose (friction, felt damping, string, sensor errors), by about "
        "what is uncertain of a real one. The verdict below says whether that shows; agreement means that the chain "
        "works, not that the model is right.",
        "The report shows every curve, measured and predicted, with uncertainty and the scatter from blow to blow.",
    ]


def next_commands(session: Path) -> list[tuple[str, str]]:
    return [
        (f"pianorig open {session}", "the report, in the browser"),
        (f"pianorig info {session}", "what was recorded"),
        ("pianorig examples try", "small files to try every other command with"),
        ("pianorig --help", "all commands"),
    ]


def figure_lines(figures: Figures) -> list[str]:
    """Lines of a table of what the demo measured: run time and error of a simulation, tracking speed and errors, run
    time by stage, memory."""
    mdeg = 1e3 * 180 / math.pi
    rows = [
        ("simulation of 0.7 s of trial 1, warm", f"{figures.simulation_s * 1e3:.0f} ms"),
        ("its error, from a run at 1e-9 rad", f"{figures.simulation_error_rad:.1e} rad"),
        ("tracking of three bodies together", f"{figures.tracking_frames_per_s:.0f} frames/s"),
    ]
    for t in figures.tracking:
        rows += [
            (f"{t.body}: RMS error ({t.lost} frames lost)", f"{t.rms_rad * mdeg:.1f} mdeg"),
            (f"{t.body}: stated uncertainty; Cramer-Rao bound",
             f"{t.stated_u_rad * mdeg:.1f}; {t.bound_rad * mdeg:.1f} mdeg"),
        ]  # fmt: skip
    parts = ", ".join(f"{name} {value:.0f}" for name, value in figures.seconds.items())
    rows.append((f"run time: {parts}", f"{sum(figures.seconds.values()):.0f} s"))
    if figures.peak_memory_mib is not None:
        rows.append(("largest memory", f"{figures.peak_memory_mib:.0f} MiB"))
    return table_lines(("measured in this run", "value"), rows)
