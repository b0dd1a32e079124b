"""Small files to try the commands with: tables of force and motion, a felt, films, a rig, a recording to import."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import model
import vision
from pianorig.console.column_file import check_writable, make_folder
from pianorig.errors import CommandInputError
from rig.atomic_write import write_text
from rig.configuration.rig_file import COUNTS_PER_REVOLUTION
from rig.configuration.rig_file import FOLDER as RIGS
from rig.simulated import ActionGeometry, CameraSettings, film_bodies, film_trial

Table = dict[str, NDArray[np.float64]]
PRELOAD_N = 0.05  # as the built-in rig
QUIET_S = 0.3  # before the blow: 15 periods of 50 Hz
FELT_DEPTH_M = 5e-4  # of a press: choice, as far as 15 N take contact02
FELT_LOSS = 0.12  # half of the difference between pressing and releasing, of the force between them: choice
PRESS_BETA, PRESS_ETA = (0.15,), (0.2,)  # half width of the loop over force, reach of its memory over depth: choice
NOISE_N = 0.02  # of the cell, as the virtual bench
DEPTHS_MM, SPEEDS_MM_PER_S = (
    (0.2, 0.35, 0.5),
    (2.0, 10.0, 50.0),
)  # of the presses: up to FELT_DEPTH_M, a decade and more
PRESS_SAMPLES = 301  # of a press and its release: choice
KEPT = ("", ".csv", ".h5", ".jsonl", ".md", ".toml", ".txt")
"""Endings of what was recorded and is said of it; reports and curves are made again."""


def force_table(name: str) -> Table:
    time_s, force_n = model.force_table(name)
    return {"time_s": time_s, "force_n": force_n}


def simulated_blow() -> model.Solution:
    """The motion of the built-in action under the example force."""
    return model.simulate(model.load_action(), *model.force_table("forte"))


def key_motion(blow: model.Solution) -> Table:
    """The key's angle since rest, in whole counts of an encoder as a bench would record it."""
    step = 2.0 * np.pi / COUNTS_PER_REVOLUTION["key"]
    turned = blow.angle_rad[:, 0] - blow.angle_rad[0, 0]
    return {"time_s": blow.time_s, "key_rad": np.round(turned / step) * step}


def felt_loading() -> Table:
    """Columns of one press and release of the felt at the key front: displacement, m, and force, N: its cubic (eq.
    2.5), a loop about that, noise of the cell."""
    action = model.load_action()
    a, b, c = (action[f"contact02.normal.{name}"] for name in "abc")
    pressed = np.linspace(0.0, FELT_DEPTH_M, 60)
    middle = ((a * pressed + b) * pressed + c) * pressed
    noise = np.random.default_rng(2).normal(0.0, NOISE_N, 2 * pressed.size)
    force = np.concatenate([middle * (1 + FELT_LOSS), (middle * (1 - FELT_LOSS))[::-1]]) + noise
    return {"displacement_m": np.concatenate([pressed, pressed[::-1]]), "force_n": force}


def felt_presses() -> dict[str, Table]:
    """Presses of a hereditary felt at several speeds to several depths, by name, columns each: time, s, displacement,
    m, force, N, with noise of the cell."""
    action, rng = model.load_action(), np.random.default_rng(4)
    a, b, c = (action[f"contact02.normal.{name}"] for name in "abc")
    law = model.felt.Hysteresis(a, b, c, PRESS_BETA, PRESS_ETA)
    out = {}
    for depth_mm in DEPTHS_MM:
        for speed_mm_per_s in SPEEDS_MM_PER_S:
            seconds = 2.0 * depth_mm / speed_mm_per_s
            time_s = np.linspace(0.0, seconds, PRESS_SAMPLES)
            depth_m = 1e-3 * (depth_mm - speed_mm_per_s * np.abs(time_s - 0.5 * seconds))
            force_n = law.response(time_s, depth_m).force_n + rng.normal(0.0, NOISE_N, time_s.size)
            out[f"{depth_mm}mm_{speed_mm_per_s:g}mm_per_s"] = {
                "time_s": time_s, "displacement_m": depth_m, "force_n": force_n
            }  # fmt: skip
    return out


def lab_recording(blow: model.Solution) -> Table:
    """Columns of the forte blow as another program would have recorded it: times, s, force, N, with noise, encoder
    counts of each body; a quiet time comes first."""
    rate_hz = 1.0 / float(blow.time_s[1] - blow.time_s[0])
    quiet = round(QUIET_S * rate_hz)
    _, force_n = model.force_table("forte")
    noise = np.random.default_rng(3).normal(0.0, NOISE_N, quiet + force_n.size)
    columns: Table = {
        "time_s": np.arange(quiet + force_n.size) / rate_hz,
        "force_n": np.concatenate([np.zeros(quiet), force_n]) + noise,
    }
    for body, counts in COUNTS_PER_REVOLUTION.items():
        angle = blow.angle_rad[:, model.BODIES.index(body)]
        turned = np.round((angle - angle[0]) * counts / (2.0 * np.pi))
        columns[f"{body}_counts"] = np.concatenate([np.zeros(quiet), turned])
    return columns


def table_text(columns: Table) -> str:
    """CSV, with as many digits as the numbers need."""
    rows = zip(*(column.tolist() for column in columns.values()), strict=True)
    return "\n".join([",".join(columns), *(",".join(f"{value:.9g}" for value in row) for row in rows)]) + "\n"


CAMERA = CameraSettings(width=280, height=212, scale_px_per_m=2240.0)  # 0.7 of the virtual bench's: a smaller file
FRAMES = 150  # of the film: 75 ms
START_S = 0.045  # the example force begins at 0.05 s, the bodies move from 0.065 s on
GRID, PITCH_M = (9, 6), 5e-3  # inner corners of the target, and their distance: it fits the picture
VIEWS = 12  # of the target, round a circle
DARK, BRIGHT, NOISE = 40.0, 200.0, 1.5  # grey of 8 bit: choice, not saturated
TURN_RAD = 0.12  # of the target, to each side: choice, held by hand
SUBPIXELS = 4  # a side of a pixel's mean: edges are right to a sixteenth of their grey


def write_blow_film(path: Path, bodies: Path, blow: model.Solution, frames: int = FRAMES) -> None:
    """Render the blow of the example force on the default action, ``frames`` frames from 0.045 s on, into ``path``
    (.mraw, header .cihx beside it); write the bodies' outlines to ``bodies`` (TOML)."""
    column = [model.BODIES.index(name) for name in ("whippen", "jack", "repetition")]
    relative = blow.angle_rad[:, column]  # jack and lever from the whippen, as the camera wants them

    def angles_at(time_s: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.stack([np.interp(time_s, blow.time_s, relative[:, k]) for k in range(3)], axis=1)

    action = model.load_action()

    def pivot(body: str) -> tuple[float, float]:
        return action[f"{body}.pivot.x"], action[f"{body}.pivot.y"]

    whippen, jack, repetition = (float(value) for value in relative[0])
    geometry = ActionGeometry(pivot("whippen"), pivot("jack"), pivot("repetition"), (whippen, jack, repetition))
    times = START_S + (np.arange(frames) + 0.5) / CAMERA.frame_rate_hz
    film_trial(path, np.asarray(times, dtype=np.float64), angles_at, geometry, CAMERA, seed=1)
    vision.save_bodies(bodies, film_bodies(geometry, CAMERA))


def write_target_film(path: Path) -> None:
    """Film a checkerboard of 9 x 6 inner corners, 5 mm apart, held flat and moved within the plane of motion."""
    vision.write_mraw(path, _target_frames(), CAMERA.frame_rate_hz, bit_depth=8, comment="synthetic calibration target")


def _target_frames() -> Iterator[NDArray[np.uint8]]:
    """Yield pictures (height, width), 8 bits, of a checkerboard moved and turned in its plane, with noise, for the
    calibration of the camera."""
    random = np.random.default_rng(4)
    pitch_px = PITCH_M * CAMERA.scale_px_per_m
    room = 0.5 * np.array([CAMERA.width, CAMERA.height]) - 0.5 * pitch_px * (np.array(GRID) + 1.5)
    for k in range(VIEWS):
        turn = 2.0 * np.pi * k / VIEWS
        place = 0.5 * np.array([CAMERA.width, CAMERA.height]) + room * np.array([np.cos(turn), np.sin(turn)])
        picture = _draw_checkerboard(place, TURN_RAD * np.sin(3.0 * turn), pitch_px)
        noisy = picture + random.normal(0.0, NOISE, picture.shape)
        yield np.clip(np.rint(noisy), 0, 255).astype(np.uint8)


def _draw_checkerboard(centre_px: NDArray[np.float64], turn_rad: float, pitch_px: float) -> NDArray[np.float64]:
    """Draw the calibration target, turned by ``turn_rad`` (as x turns to y, which points down), as a noiseless picture
    (height, width) of grey values, each pixel averaged over points within it.

    ``centre_px`` (x, y) is the middle of the target, ``pitch_px`` the width of a square.
    """
    (columns, rows), c, s = GRID, np.cos(turn_rad), np.sin(turn_rad)
    y, x = np.indices((CAMERA.height, CAMERA.width), dtype=float)
    total = np.zeros(x.shape)
    shifts = (np.arange(SUBPIXELS) + 0.5) / SUBPIXELS - 0.5
    for dx in shifts:
        for dy in shifts:
            east, south = x + dx - centre_px[0], y + dy - centre_px[1]
            u = (c * east + s * south) / pitch_px + 0.5 * (columns - 1)
            v = (-s * east + c * south) / pitch_px + 0.5 * (rows - 1)
            inside = (np.abs(u - 0.5 * (columns - 1)) < 0.5 * (columns + 1)) & (
                np.abs(v - 0.5 * (rows - 1)) < 0.5 * (rows + 1)
            )
            total += np.where(inside & ((np.floor(u) + np.floor(v)) % 2 == 0), DARK, BRIGHT)
    return total / SUBPIXELS**2


EXAMPLES = {
    "force.csv": "force of a forte blow: simulate --force, study variants --force, calibrate felt --force",
    "recorded_force.csv": "force as a pianist's key saw it, after the thesis's Fig. 4.1: learn",
    "key.csv": "motion of the key since rest, in encoder counts: simulate --key-motion --from-rest",
    "felt.csv": "one press and release of a felt: calibrate felt",
    "presses": "folder: nine presses of a felt at three speeds to three depths: calibrate felt presses/*.csv",
    "lab.csv": "a blow recorded by another program: import",
    "lab.toml": "what is what in lab.csv: import --mapping",
    "film.mraw": "film of a blow, 150 frames at 2000 frames/s, its header in film.cihx: track, attach",
    "bodies.toml": "outlines of the bodies in film.mraw: track --bodies",
    "target.mraw": "film of a checkerboard, 9x6 corners 5 mm apart: calibrate camera",
    "plan.toml": "piano and forte in random order: record --plan",
    "my_rig.toml": "a bench on one PCIe-6363, to be changed into yours: --rig",
    "sessions/planted_faults": "nine simulated blows with one known fault each: validate",
    "sessions/kawai_kg3c": "a real action, positions of key and hammer (Piano-Data, MIT): validate --action",
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
    """Write the example files and sessions into ``folder`` and return their paths by name; `CommandInputError`, before
    anything is written, where a file is there; a session that is there stays."""
    paths = {name: folder / name for name in EXAMPLES}
    sessions = {name: paths.pop(name) for name in EXAMPLES if name.startswith("sessions/")}
    there = [path for path in (*paths.values(), folder / "film.cihx", folder / "target.cihx") if path.exists()]
    if there:
        raise CommandInputError(f"{there[0]}: is there already and would be written over; name another folder")
    make_folder(folder, parents=True)
    check_writable(paths["force.csv"])
    working("simulating a blow")
    blow = simulated_blow()
    texts = {
        "force.csv": table_text(force_table("forte")),
        "recorded_force.csv": table_text(force_table("thesis-forte")),
        "key.csv": table_text(key_motion(blow)),
        "felt.csv": table_text(felt_loading()),
        "lab.csv": table_text(lab_recording(blow)),
        "lab.toml": MAPPING + "".join(_encoder(body) for body in COUNTS_PER_REVOLUTION),
        "plan.toml": PLAN,
        "my_rig.toml": (RIGS / "pcie6363.toml").read_text("utf-8").replace('name = "pcie6363"', 'name = "my_rig"', 1),
    }
    paths["presses"].mkdir()
    texts |= {f"presses/{name}.csv": table_text(press) for name, press in felt_presses().items()}
    for name, text in texts.items():
        write_text(folder / name, text)
    working("filming")
    write_blow_film(paths["film.mraw"], paths["bodies.toml"], blow)
    write_target_film(paths["target.mraw"])
    for name, place in sessions.items():
        if not place.exists():
            _copy_session(name, place)
    return paths | sessions


def _copy_session(name: str, target: Path) -> None:
    """Copy the session folder ``name`` that comes with the package to ``target``: its own files and tracked angles, not
    what can be made from them again."""
    package = Path(__file__).parents[1]
    source = next(path for path in (package / name, package.parent / name) if path.is_dir())  # a wheel's, a checkout's
    for file in sorted(source.rglob("*")):
        at = file.relative_to(source)
        if file.is_file() and (len(at.parts) == 1 or at.parts[:2] == ("derived", "angles")) and file.suffix in KEPT:
            (target / at).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(file, target / at)


def _encoder(body: str) -> str:
    return (
        f'\n[[encoders]]\nname = "{body}"\nchannel = "{body}_counts"\nunit = "counts"\n'
        f"counts_per_revolution = {COUNTS_PER_REVOLUTION[body]}\nsign = 1\n"
    )
