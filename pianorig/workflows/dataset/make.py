"""Make the published data set: an open split from a seed, a sealed one from randomness nobody keeps.

Each specimen stands on a bench of its own (`ActionPlant` behind the virtual NI-DAQmx device), and `rig.record` plays
and records its strokes as it would on hardware: anti-alias filter, group delay, codes, counters. What is published of a
trial is read from its sealed file; faults are planted afterwards. Jack and repetition lever are filmed around the
stroke, at half the scale of the bench's own film, and their angles are what `vision.track` makes of it. The pictures of
one film a level stay: small, lossless, in a file that any picture program opens, with the outlines beside it."""

from __future__ import annotations

import json
import secrets
import shutil
import tempfile
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

import model
import rig
import vision
from pianorig.errors import CommandInputError
from pianorig.workflows.dataset.describe import descriptions
from pianorig.workflows.recording import action_geometry
from rig.atomic_write import write_text
from rig.configuration.profile import Profile
from rig.simulated import ActionPlant, CameraSettings, build_device, film_bodies, film_trial, load_plant
from rig.simulated.backend import DEFAULT_BENCH, SimulatedBackend
from rig.simulated.bench.sensors import load_sensors
from validation.dataset.files import INDEX, SCHEMA, DataTrial, salted_sha256, truth_text, write_netcdf
from vision.film.open import open_film

Array = NDArray[np.float64]

RATE_HZ = 5000.0
WINDOW_S = 0.2
"""Rest before each stroke: the initialisation window."""
AFTER_S = 0.25

FORTE = ((0.0, 0.0), (0.01, 0.435), (0.02, 1.46), (0.03, 2.97), (0.04, 4.92), (0.05, 7.27), (0.06, 10.0))
"""Rise of a forte, s and N."""
PIANO = ((0.0, 0.0), (0.15, 1.25), (0.16, 1.25), (0.175, 0.72), (0.215, 0.72), (0.28, 1.5), (0.5, 1.5), (0.57, 0.0))


@dataclass(frozen=True)
class Condition:
    """A kind of stroke: its name and corner points of the nominal force, s and N."""

    name: str
    points: tuple[tuple[float, float], ...]

    def corners(self, strength: float = 1.0, stretch: float = 1.0) -> tuple[Array, Array]:
        """Corner points of the motor's profile, s and N, with rest before and after, stronger or slower by a factor."""
        times = WINDOW_S + stretch * np.array([t for t, _ in self.points])
        values = strength * np.array([f for _, f in self.points])
        return np.concatenate([[0.0], times, [times[-1] + AFTER_S]]), np.concatenate([[0.0], values, [0.0]])


def _strokes(level: float, onsets: tuple[float, ...], hold_s: float, fall_s: float) -> tuple[tuple[float, float], ...]:
    points: list[tuple[float, float]] = []
    for onset in onsets:
        points += [(onset + t, level / 10.0 * f) for t, f in FORTE]
        points += [(onset + 0.06 + hold_s, level), (onset + 0.06 + hold_s + fall_s, 0.0)]
    return tuple(points)


CONDITIONS = (
    Condition("forte", _strokes(10.0, (0.0,), 0.2, 0.09)),
    Condition("mezzoforte", _strokes(7.0, (0.0,), 0.2, 0.09)),
    Condition("mezzo", _strokes(5.0, (0.0,), 0.2, 0.09)),
    Condition("mezzopiano", _strokes(3.5, (0.0,), 0.2, 0.09)),
    Condition("piano", PIANO),
    Condition("double", _strokes(10.0, (0.0, 0.2), 0.05, 0.03)),
    Condition("staccato", _strokes(8.0, (0.0,), 0.01, 0.02)),
    Condition("repetition", _strokes(6.0, (0.0, 0.16, 0.32, 0.48), 0.03, 0.03)),
)


BASE = "hirschkorn2004-regulated"
SCREWS = {"contact08.second.y": 2e-4, "contact11.first.y": 2e-4, "contact04.second.x": 5e-4}
"""Regulation: standard deviations, m."""
FACTORS = {
    "key.joint_friction.A": 0.3, "whippen.joint_friction.A": 0.3, "hammer.joint_friction.A": 0.3,
    "contact01.friction.A": 0.2, "contact04.friction.A": 0.2, "contact07.friction.A": 0.2, "contact10.friction.A": 0.2,
    "contact01.normal.D": 0.3, "contact02.normal.D": 0.3, "contact03.normal.D": 0.3, "contact12.normal.D": 0.1,
    "hammer.mass": 0.03, "key.inertia": 0.03, "repetition_spring.stiffness": 0.05, "jack_spring.torque": 0.1,
}  # fmt: skip
"""Standard deviations of logarithms."""
SCATTER = {"key.joint_friction.A": 0.03, "contact07.friction.A": 0.02, "contact04.friction.A": 0.02}
"""What changes from trial to trial, relative."""
MOST = 2.0
"""Draws are cut at so many standard deviations."""


@dataclass(frozen=True)
class Specimen:
    """A specimen: its name, changed parameters, the true gain of the motor, the seed of its scatter, and its scene."""

    name: str
    changed: dict[str, float]
    torque_per_volt_nm: float
    seed: int
    scene: str = "whole"

    def action(self) -> model.Action:
        """The action with its parameters, in its scene."""
        return model.load_scene(self.scene).on(model.load_action(BASE)).with_values(self.changed)


def draw_specimen(name: str, random: np.random.Generator, scene: str = "whole") -> Specimen:
    """Draw a specimen that can be played: one whose rest cannot be found is drawn again."""
    base = model.load_scene(scene).on(model.load_action(BASE))
    while True:
        changed = {path: base[path] + sd * _cut(random) for path, sd in SCREWS.items()}
        changed |= {path: base[path] * float(np.exp(sd * _cut(random))) for path, sd in FACTORS.items()}
        gain = 1.2 * float(np.exp(0.01 * _cut(random)))
        seed = int(random.integers(2**31))
        try:
            model.rest_state(base.with_values(changed))
        except model.ModelError:
            continue
        return Specimen(name, changed, gain, seed, scene)


def _cut(random: np.random.Generator) -> float:
    return float(np.clip(random.standard_normal(), -MOST, MOST))


RIG = "virtual"
FILM_HZ = 2000.0
U = {
    "force": 0.05, "motor_command": 1e-3, "key_angle": 5e-5, "whippen_angle": 5e-5, "hammer_angle": 5e-5,
    "film_time": 1e-5,
}  # fmt: skip
"""Standard uncertainties that are published; the force's without its level, which the rest before the stroke shows.
Those of the filmed angles are the tracker's: the median over the frames of a trial."""
TRACKED = {"jack_angle": "jack", "repetition_angle": "repetition"}
BODIES = {"key_angle": "key", "whippen_angle": "whippen", "hammer_angle": "hammer"}
HUM_HZ = 60.0
FAULTS = ("force gain", "hammer sign", "key counts", "film late", "hum", "force drift")


@dataclass(frozen=True)
class Played:
    """A trial as it is published, and what is true of it; of its pictures, how many, and when the first began, s."""

    trial: DataTrial
    truth: dict[str, Any]
    pictures: tuple[int, float]


class SpecimenBench:
    """A virtual bench with a specimen under the arm of its motor; trials are played one after the other.

    Parameters
    ----------
    specimen : Specimen
    """

    def __init__(self, specimen: Specimen) -> None:
        self.seed = specimen.seed
        bench = load_plant(DEFAULT_BENCH, specimen.seed, RATE_HZ, scene=specimen.scene)
        action = bench.choice.on(specimen.action())
        plant = ActionPlant(action, bench.choice, specimen.torque_per_volt_nm, SCATTER, specimen.seed, RATE_HZ)
        self.rig = rig.load_rig(RIG)
        sensors = load_sensors(DEFAULT_BENCH, seed=specimen.seed)
        self.backend = SimulatedBackend(build_device(self.rig.config, plant, sensors))

    def close(self) -> None:
        """Give the virtual device back."""
        self.backend.close()

    def play(
        self, number: int, condition: Condition, fault: str, random: np.random.Generator, pictures: Path | None = None
    ) -> Played:
        """Record and film one stroke.

        Parameters
        ----------
        number : int
            Of the trial.
        condition : Condition
        fault : str
            One of `FAULTS`, or empty.
        random : Generator
            For how it is played and what the film's clock and faults add.
        pictures : path, optional
            TIFF file to keep the pictures of the film in; outlines are written beside it.

        Raises
        ------
        CommandInputError
            The pictures cannot be written.
        """
        strength, stretch = (float(np.exp(sd * np.clip(random.standard_normal(), -2, 2))) for sd in (0.05, 0.04))
        times, forces = condition.corners(strength, stretch)
        self.backend.continue_after(number - 1)
        late = 1e-5 * float(np.clip(random.standard_normal(), -2, 2))
        with tempfile.TemporaryDirectory() as folder:
            session = rig.record(
                Path(folder) / "session", profile=Profile(condition.name, times, forces), rig_config=self.rig,
                trials=1, backend=self.backend,
            )  # fmt: skip
            data = session.trial(1).read()
            plant = self.backend.plant
            assert isinstance(plant, ActionPlant) and data.camera is not None
            motion = plant.truth()
            first = data.blow_start_s - BEFORE_S
            last = min(first + times[-1] - times[1] - AFTER_S + BEFORE_S + FILMED_AFTER_S, first + LONGEST_S)
            film_s = data.camera.frame_time_s
            film_s = film_s[(film_s >= first) & (film_s < min(last, data.time_s[-1], motion.time_s[-1]) - 1e-3)]
            geometry = action_geometry(motion)
            film, bodies = Path(folder) / "film.mraw", film_bodies(geometry, SETTINGS)
            film_trial(film, film_s, lambda t: motion.film_angles_at(t + late), geometry, SETTINGS, self.seed + number)
            tracked = vision.track(film, bodies)
            shown = 0 if pictures is None else write_pictures(pictures, film, bodies)
        relative = {name: tracked.relative(body) for name, body in TRACKED.items()}
        angles = dict(zip((one.name for one in data.encoders), data.angle_rad().T, strict=True))
        values = {
            # what a sample shows is one group delay old
            "force": np.interp(data.time_s + data.force_info.group_delay_s, data.time_s, data.force_n),
            "motor_command": data.motor_command_v,
            **{name: angles[body] - angles[body][0] for name, body in BODIES.items()},
            **{name: angle for name, (angle, _, _) in relative.items()},
        }
        u = U | {name: float(np.nanmedian(of_frame)) for name, (_, of_frame, _) in relative.items()}
        published_s = plant_fault(fault, data.time_s, film_s, values) if fault else film_s
        facts = {"trial": number, "condition": condition.name}
        trial = DataTrial(data.time_s, published_s, values, u, facts)
        truth = {"strength": strength, "stretch": stretch, "film_late_s": late, "fault": fault}
        return Played(trial, truth, (shown, float(published_s[0])))


def plant_fault(fault: str, time_s: Array, film_s: Array, values: dict[str, Array]) -> Array:
    """Put a fault into the values of a trial; return the film's times, which it may change."""
    if fault == "force gain":
        values["force"] = 1.15 * values["force"]
    elif fault == "hammer sign":
        values["hammer_angle"] = -values["hammer_angle"]
    elif fault == "key counts":
        at = int(np.argmin(values["key_angle"]))
        values["key_angle"] = values["key_angle"] + np.where(np.arange(time_s.size) > at, 0.003, 0.0)
    elif fault == "film late":
        return film_s + 3e-3
    elif fault == "hum":
        values["force"] = values["force"] + 0.8 * np.sin(2.0 * np.pi * HUM_HZ * time_s)
    elif fault == "force drift":
        values["force"] = values["force"] + 1.0 * (time_s - time_s[0])
    return film_s


LEVELS = ("forte", "mezzoforte", "mezzo", "mezzopiano", "piano")
SETTINGS = CameraSettings(
    frame_rate_hz=FILM_HZ, width=200, height=152, scale_px_per_m=1600.0, noise_grey=1.0, flicker=0.0
)
BEFORE_S, FILMED_AFTER_S, LONGEST_S = 0.03, 0.1, 2.0
"""Filmed is from so long before the stroke until so long after its force has ended, at most so long in all."""
PICTURES = 600
"""Kept are so many pictures of a film."""
ADOBE_DEFLATE, PREDICTOR = 8, 2
OUTLINES = "bodies.toml"


def write_pictures(path: Path, film: Path, bodies: list[vision.Body]) -> int:
    """Copy the first pictures of a film into a TIFF file, the outlines beside it; return how many they are.

    Raises
    ------
    CommandInputError
        The file cannot be written.
    """
    with open_film(film) as opened:
        frames = [np.array(opened.read(k)) for k in range(min(PICTURES, opened.n_frames))]
    options = [cv2.IMWRITE_TIFF_COMPRESSION, ADOBE_DEFLATE, cv2.IMWRITE_TIFF_PREDICTOR, PREDICTOR]
    if not cv2.imwritemulti(str(path), frames, options):
        raise CommandInputError(f"{path}: the film cannot be written; name another folder")
    vision.save_bodies(path.with_name(path.stem + "_" + OUTLINES), bodies)
    return len(frames)


SEED = 20041
EACH = 3
"""Trials of each condition and specimen: two to train on, one to test."""
MOST_EACH = 50
FAULT_SHARE = 0.125
OPEN_TRUTH = "truth_open.json"
SPECIMENS = ("A", "B")


def make_dataset(
    out: Path,
    *,
    seed: int = SEED,
    each: int = EACH,
    sealed_truth: Path | None = None,
    films: bool = True,
    scene: str = "whole",
    say: Callable[[str], None] = lambda text: None,
) -> dict[str, int]:
    """Make the data set in a new folder.

    Parameters
    ----------
    out : path
        A folder that does not exist yet.
    seed : int
        Of the open split.
    each : int
        Trials of each condition and specimen; the last of them is for testing.
    sealed_truth : path, optional
        Where the truth of a sealed split is kept, outside ``out``; without it there is no sealed split.
    films : bool
        Keep the pictures of the first stroke of each level.
    scene : str
        Scene of the specimens, by name or file; only the truth states it.
    say : callable
        Told of the progress.

    Returns
    -------
    dict
        Number of trials by split.

    Raises
    ------
    CommandInputError
        The folder exists, the truth would be published with the data, or a number is out of range.
    """
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise CommandInputError(f"{out}: exists already; choose another name")
    if not 2 <= each <= MOST_EACH:
        raise CommandInputError(f"--each {each}: allowed 2 to {MOST_EACH}")
    if sealed_truth is not None and (sealed_truth.exists() or out.resolve() in sealed_truth.resolve().parents):
        raise CommandInputError(f"{sealed_truth}: exists, or lies in {out}, where it would be published")
    existed = out.is_dir()
    try:
        truths = {"open": out / OPEN_TRUTH} | ({} if sealed_truth is None else {"sealed": sealed_truth})
        return _make(out, seed, each, truths, (films, scene, say))
    except BaseException:
        if not existed:
            shutil.rmtree(out, ignore_errors=True)
        raise


Drawn = tuple[bool, str, Callable[[str], None]]
"""Whether there are films, the specimens' scene, and who is told of the progress."""


def _make(out: Path, seed: int, each: int, truths: dict[str, Path], drawn: Drawn) -> dict[str, int]:
    """Write the splits whose ``truths`` are kept in these files: ``open`` from the seed, ``sealed`` from none."""
    out.mkdir(parents=True, exist_ok=True)
    rows: dict[str, list[dict[str, Any]]] = {}
    seals: dict[str, str] = {}
    for split, path in truths.items():
        again = split == "open"
        random = np.random.default_rng([seed, 1] if again else secrets.randbits(128))
        rows[split], truth = _split(out, split, random, each, drawn)
        salt = f"open split of seed {seed}" if again else secrets.token_hex(32)
        seals[split] = salted_sha256(truth_text(truth), salt)
        path.parent.mkdir(parents=True, exist_ok=True)
        write_text(path, json.dumps({"salt": salt, "truth": truth}, indent=1, sort_keys=True) + "\n")
    index = {
        "schema": SCHEMA,
        "window_s": WINDOW_S,
        "sample_rate_hz": RATE_HZ,
        "film_rate_hz": FILM_HZ,
        "seed": seed,
        "each": each,
        "open_truth": OPEN_TRUTH,
        "seal": seals,
        "trials": rows,
    }
    write_text(out / INDEX, json.dumps(index, indent=1) + "\n")
    for name, text in descriptions(out, index).items():
        write_text(out / name, text)
    return {name: len(part) for name, part in rows.items()}


def _split(
    out: Path, split: str, random: np.random.Generator, each: int, drawn: Drawn
) -> tuple[list[dict[str, Any]], dict[str, Any]]:
    """Play and write one split; return the rows of its index and its truth."""
    (out / split).mkdir()
    films, scene, say = drawn
    rows: list[dict[str, Any]] = []
    trials, faults = {}, {}
    specimens = [draw_specimen(name, random, scene) for name in SPECIMENS]
    number = 0
    for specimen in specimens:
        bench = SpecimenBench(specimen)
        for condition in CONDITIONS:
            say(f"{split}: specimen {specimen.name}, {condition.name}")
            for k in range(each):
                number += 1
                part = "test" if k == each - 1 else "train"
                fault = str(random.choice(FAULTS)) if random.random() < FAULT_SHARE else ""
                film = f"{split}/trial_{number:04d}_film.tif"
                kept = films and not k and specimen is specimens[0] and condition.name in LEVELS
                played = bench.play(number, condition, fault, random, out / film if kept else None)
                facts = {**played.trial.facts, "specimen": specimen.name, "part": part, "title": f"{split} {number}"}
                file = f"{split}/trial_{number:04d}.nc"
                write_netcdf(out / file, replace(played.trial, facts=facts))
                row = {"file": file, "trial": number, "specimen": specimen.name, "condition": condition.name,
                       "part": part}  # fmt: skip
                if kept:
                    frames, first_s = played.pictures
                    row |= {"film": film, "film_frames": frames, "film_first_s": first_s}
                rows.append(row)
                trials[str(number)] = played.truth
                if fault:
                    faults[str(number)] = fault
        bench.close()
    return rows, {"specimens": [asdict(one) for one in specimens], "trials": trials, "faults": faults}
