"""One module per command, each a thin call of a documented function of the packages below.

The table lists what ``pianorig --help`` prints; a command's module is imported when the command runs or its own
``--help`` is asked for. In: options as typed by typer; out: lines or JSON on standard output, files, the exit code.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import Any, NamedTuple


class Listed(NamedTuple):
    """Module of a command below ``pianorig.commands``, and the first line of its help."""

    module: str
    help: str


COMMANDS = {
    "demo": Listed("demo", "Record five virtual blows, film and track one, report."),
    "examples": Listed("examples", "Write small files to try every command with."),
    "open": Listed("open_report", "Open a session's report in the browser."),
    "info": Listed("info", "Show a session, a backend, or the installed versions."),
    "record": Listed("bench.record", "Play a motor profile; record force, angles, frame clock."),
    "learn": Listed("bench.learn", "Learn motor profiles whose force follows recorded ones."),
    "recover": Listed("bench.recover", "Rebuild unsealed trials from the journals of a recording."),
    "import": Listed("bench.import_recording", "Make a session of recordings by other programs."),
    "export": Listed("bench.export", "Write trials as CSV, MATLAB, TDMS or Parquet."),
    "attach": Listed("film.attach", "Check a film against a trial; copy it beside the trial."),
    "annotate": Listed("bench.annotate", "Add a line to a session's annotations, or list them."),
    "bench": Listed("bench.bench_page", "Show sessions in the browser until Ctrl-C."),
    "watch": Listed("bench.watch", "Show force and angles of the trial being recorded."),
    "track": Listed("film.track", "Track rigid bodies; give angles and their uncertainty."),
    "calibrate-camera": Listed("film.calibrate_camera", "Measure the camera's tilt, distortion and scale."),
    "simulate": Listed("model.simulate", "Predict motion under a force, or the force of a motion."),
    "touch": Listed("model.touch", "Compare how actions feel, from slow press to repetition."),
    "study": Listed("model.study", "Ask what if: variants of an action under one blow."),
    "sensitivity": Listed("model.sensitivity", "Rank parameters by what they do to a blow."),
    "regulate": Listed("model.regulate", "Measure and regulate an action as a technician does."),
    "calibrate-felt": Listed("model.calibrate_felt", "Calibrate felt, friction, string damping and inertia."),
    "calibrate-drive": Listed("model.calibrate_drive", "Identify the motor's drive from a log of the bench."),
    "validate": Listed("validation.validate", "Report how well models predict the measured angles."),
    "dataset": Listed("validation.dataset", "Make the published data set, or score predictions on it."),
    "identify": Listed("validation.identify", "Find parameter values from strokes; say what is unknown."),
    "calibrate-force": Listed("bench.calibrate_force", "Calibrate the load cell: weights, shunt or zero."),
    "calibrate-encoder": Listed("bench.calibrate_encoder", "Calibrate an encoder over its arc."),
    "calibrate-contact": Listed("bench.calibrate_contact", "Calibrate the friction of a contact."),
    "calibrate-joint": Listed("bench.calibrate_joint", "Calibrate the friction of a joint."),
    "serve-sim": Listed("bench.serve_sim", "Serve the virtual DAQ device over TCP until Ctrl-C."),
    "selftest": Listed("bench.selftest", "Test a bench with gentle pushes before the first blow."),
}
"""Every command; ``--help`` lists them in this order within their group."""

GROUPS = {
    "": "First steps and help",
    "bench": "Bench",
    "film": "Films",
    "model": "Model",
    "validation": "Model and measurement",
}
"""Heading of the commands in each folder; the first is that of this folder itself."""


def groups() -> dict[str, list[str]]:
    """Names of the commands under the heading of their module's folder, in the order of the headings."""
    found: dict[str, list[str]] = {title: [] for title in GROUPS.values()}
    for name, listed in COMMANDS.items():
        found[GROUPS[listed.module.rpartition(".")[0]]].append(name)
    return found


def load(name: str) -> Callable[..., Any]:
    """Import the module of a command and return its function."""
    function: Callable[..., Any] = import_module(f"{__name__}.{COMMANDS[name].module}").command
    return function
