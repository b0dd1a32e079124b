"""One module per command, each a call of documented functions of the packages below."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import Any, NamedTuple


class Listed(NamedTuple):
    """Module of a command below ``pianorig.commands``, its heading, the first line of its help, its function."""

    module: str
    group: str
    help: str
    function: str = "command"


FIRST, BENCH, FILMS, MODEL, COMPARED = GROUPS = (
    "First steps and help", "Bench", "Films", "Model", "Model and measurement"
)  # fmt: skip
"""Headings of the commands, in their order."""

COMMANDS = {
    "demo": Listed("demo", FIRST, "Record five virtual blows, film and track one, report."),
    "examples": Listed("examples", FIRST, "Write small files to try every command with."),
    "open": Listed("open_report", FIRST, "Open a session's report in the browser."),
    "info": Listed("info", FIRST, "Show a session, a recording, a backend or the versions; propose a rig file."),
    "record": Listed("record", BENCH, "Play a motor profile; record force, angles, frame clock."),
    "learn": Listed("learn", BENCH, "Learn motor profiles whose force follows recorded ones."),
    "recover": Listed("recover", BENCH, "Rebuild unsealed trials from the journals of a recording."),
    "import": Listed("import_recording", BENCH, "Make a session of recordings by other programs."),
    "export": Listed("export", BENCH, "Write trials as CSV, MATLAB, TDMS or Parquet."),
    "attach": Listed("attach", FILMS, "Check a film against a trial; copy it beside the trial."),
    "annotate": Listed("annotate", BENCH, "Add a line to a session's annotations, or list them."),
    "bench": Listed("bench_page", BENCH, "Show sessions in the browser until Ctrl-C."),
    "watch": Listed("watch", BENCH, "Show force and angles of the trial being recorded."),
    "track": Listed("track", FILMS, "Track rigid bodies; give angles and their uncertainty."),
    "simulate": Listed("simulate", MODEL, "Predict motion under a force, or the force of a motion."),
    "touch": Listed("touch", MODEL, "Compare how actions feel, from slow press to repetition."),
    "study": Listed("", MODEL, "Compare a blow on variants of an action."),
    "sensitivity": Listed("sensitivity", MODEL, "Rank parameters by what they do to a blow."),
    "regulate": Listed("regulate", MODEL, "Measure and regulate an action as a technician does."),
    "validate": Listed("validate", COMPARED, "Report how well models predict the measured angles."),
    "identify": Listed("identify", COMPARED, "Find parameter values from strokes; say what is unknown."),
    "calibrate": Listed("", BENCH, "Calibrate force, encoder, joint, contact, felt, drive, camera."),
    "selftest": Listed("selftest", BENCH, "Test a bench with gentle pushes before the first blow."),
}
"""Every command and group of commands; ``--help`` lists them in this order within their heading."""

GROUPED = {
    "calibrate": {
        "force": Listed("calibrate_force", BENCH, "Calibrate the load cell: weights, shunt or zero."),
        "encoder": Listed("calibrate_encoder", BENCH, "Calibrate an encoder over its arc."),
        "joint": Listed("calibrate_joint", BENCH, "Calibrate a joint's friction by free swings on the bench."),
        "contact": Listed("calibrate_contact", BENCH, "Calibrate the friction of a contact."),
        "felt": Listed("calibrate_felt", MODEL, "Calibrate felt, friction, string damping and inertia."),
        "drive": Listed("calibrate_drive", MODEL, "Identify the motor's drive from a log of the bench."),
        "camera": Listed("calibrate_camera", FILMS, "Measure the camera's tilt, distortion and scale."),
    },
    "study": {
        "variants": Listed("study", MODEL, "Compare variants of an action under one blow.", "variants"),
        "thesis": Listed("study", MODEL, "Compare the thesis's variants of damping and friction.", "thesis"),
    },
}
"""The commands of each group."""

RETIRED_COMMANDS = {
    "dataset": "the data set is made by the script examples/dataset/make_dataset.py",
    "serve-sim": "the virtual bench is served by the script examples/serve_sim.py",
    **{f"calibrate-{what}": f"it is `pianorig calibrate {what}`" for what in GROUPED["calibrate"]},
    "study felt-law": "a law is chosen by `pianorig simulate --set contact02.law=stulov`",
    "study joints": "a blow with joints that give is `pianorig simulate --scene giving-joints`",
    "study friction-limit": "it is made by `python examples/thesis friction-limit`",
    "study string": "it is made by `python examples/thesis string`",
}
"""Commands of earlier releases: what to use instead."""


def groups() -> dict[str, list[str]]:
    """Names of the commands under their headings."""
    return {title: [name for name, listed in COMMANDS.items() if listed.group == title] for title in GROUPS}


def find(name: str) -> Listed:
    """The row of a command by its full name, such as ``record`` or ``calibrate force``."""
    group, _, word = name.partition(" ")
    return GROUPED[group][word] if word else COMMANDS[name]


def full_names() -> list[str]:
    """Every command that can be run, with the name of its group before its own."""
    return [f"{name} {word}".strip() for name in COMMANDS for word in GROUPED.get(name, {"": None})]


def load(name: str) -> Callable[..., Any]:
    """Import the module of a command by its full name and return its function."""
    listed = find(name)
    function: Callable[..., Any] = getattr(import_module(f"{__name__}.{listed.module}"), listed.function)
    return function
