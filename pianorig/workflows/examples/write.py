"""The folder of examples: what is in it, and writing it where nothing is in the way."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from pianorig.console.column_file import check_writable
from pianorig.errors import CommandInputError
from pianorig.workflows.examples import films, tables
from rig.configuration.rig_file import FOLDER as RIGS
from rig.storage.atomic_write import write_text

EXAMPLES = {
    "force.csv": "force of a forte blow: simulate --force, study --force, calibrate-felt --force",
    "recorded_force.csv": "force as a pianist's key saw it, after the thesis's Fig. 4.1: learn",
    "key.csv": "motion of the key since rest, in encoder counts: simulate --key-motion --from-rest",
    "felt.csv": "one press and release of a felt: calibrate-felt",
    "presses": "folder: nine presses of a felt at three speeds to three depths: calibrate-felt presses/*.csv",
    "lab.csv": "a blow recorded by another program: import",
    "lab.toml": "what is what in lab.csv: import --mapping",
    "film.mraw": "film of a blow, 150 frames at 2000 frames/s, its header in film.cihx: track, attach",
    "bodies.toml": "outlines of the bodies in film.mraw: track --bodies",
    "target.mraw": "film of a checkerboard, 9x6 corners 5 mm apart: calibrate-camera",
    "plan.toml": "piano and forte in random order: record --plan",
    "my_rig.toml": "a bench on one PCIe-6363, to be changed into yours: --rig",
}
"""Every file and the commands it is for."""

MAPPING = """schema = "piano-action-rig mapping 1"
simulated = true
operator = "pianorig examples"
mains_frequency_hz = 50.0

[time]
channel = "time_s"

[force]
channel = "force_n"
unit = "N"
newtons_per_unit = 1.0
"""

PLAN = """schema = "piano-action-rig plan 1"
name = "two levels"
order = "randomised"
seed = 7
rest_s = 0.5                     # between blows

[[conditions]]
name = "forte"
profile = "forte"
repeats = 2

[[conditions]]
name = "piano"
profile = "piano"
repeats = 2
"""


def write_examples(folder: Path, working: Callable[[str], None] = lambda words: None) -> dict[str, Path]:
    """Write the example files.

    Parameters
    ----------
    folder : made if it does not exist
    working : told what is being made

    Returns
    -------
    dict : name of each file and its path

    Raises
    ------
    CommandInputError : a file is there already, or the folder cannot be written; nothing was written
    """
    paths = {name: folder / name for name in EXAMPLES}
    there = [path for path in (*paths.values(), folder / "film.cihx", folder / "target.cihx") if path.exists()]
    if there:
        raise CommandInputError(f"{there[0]}: is there already and would be written over; name another folder")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as problem:
        raise CommandInputError(f"{folder}: folder cannot be made ({problem.strerror}); name another one") from None
    check_writable(paths["force.csv"])
    working("simulating a blow")
    blow = tables.simulated_blow()
    texts = {
        "force.csv": tables.table_text(tables.force_table("forte")),
        "recorded_force.csv": tables.table_text(tables.force_table("thesis-forte")),
        "key.csv": tables.table_text(tables.key_motion(blow)),
        "felt.csv": tables.table_text(tables.felt_loading()),
        "lab.csv": tables.table_text(tables.lab_recording(blow)),
        "lab.toml": MAPPING + "".join(_encoder(body) for body in tables.ENCODER_COUNTS),
        "plan.toml": PLAN,
        "my_rig.toml": (RIGS / "pcie6363.toml").read_text("utf-8").replace('name = "pcie6363"', 'name = "my_rig"', 1),
    }
    paths["presses"].mkdir()
    texts |= {f"presses/{name}.csv": tables.table_text(press) for name, press in tables.felt_presses().items()}
    for name, text in texts.items():
        write_text(folder / name, text)
    working("filming")
    films.write_blow_film(paths["film.mraw"], paths["bodies.toml"], blow)
    films.write_target_film(paths["target.mraw"])
    return paths


def _encoder(body: str) -> str:
    return (
        f'\n[[encoders]]\nname = "{body}"\nchannel = "{body}_counts"\nunit = "counts"\n'
        f"counts_per_revolution = {tables.ENCODER_COUNTS[body]}\nsign = 1\n"
    )
