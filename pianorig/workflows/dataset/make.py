"""Make the data set: an open split from a seed, a sealed one from randomness nobody keeps, and what describes them."""

from __future__ import annotations

import json
import secrets
import shutil
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from pianorig.errors import CommandInputError
from pianorig.workflows.dataset.conditions import CONDITIONS, RATE_HZ, WINDOW_S
from pianorig.workflows.dataset.describe import descriptions
from pianorig.workflows.dataset.films import LEVELS, write_film
from pianorig.workflows.dataset.play import FAULTS, FILM_HZ, SpecimenBench
from pianorig.workflows.dataset.specimens import draw_specimen
from rig.storage.atomic_write import write_text
from validation.dataset.files import INDEX, SCHEMA, salted_sha256, truth_text, write_netcdf

SEED = 20041
EACH = 3
"""Trials of each condition and specimen: two to train on, one to test."""
MOST_EACH = 50
FAULT_SHARE = 0.125
OPEN_TRUTH = "truth_open.json"
SPECIMENS = ("A", "B")


@dataclass(frozen=True)
class Made:
    """What was written: the folder, files, trials by split, and where the sealed truth is kept."""

    folder: Path
    trials: dict[str, int]
    sealed_truth: Path | None


def make_dataset(
    out: Path,
    *,
    seed: int = SEED,
    each: int = EACH,
    sealed_truth: Path | None = None,
    films: bool = True,
    scene: str = "whole",
    say: Callable[[str], None] = lambda text: None,
) -> Made:
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
        Film the first stroke of each level as pictures.
    scene : str
        Scene of the specimens, by name or file; only the truth states it.
    say : callable
        Told of the progress.

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
        return _make(out, seed, each, sealed_truth, _Drawn(films, scene, say))
    except BaseException:
        if not existed:
            shutil.rmtree(out, ignore_errors=True)
        raise


@dataclass(frozen=True)
class _Drawn:
    """Whether there are films, the specimens' scene, and who is told of the progress."""

    films: bool
    scene: str
    say: Callable[[str], None]


def _make(out: Path, seed: int, each: int, sealed_truth: Path | None, told: _Drawn) -> Made:
    out.mkdir(parents=True, exist_ok=True)
    rows: dict[str, list[dict[str, Any]]] = {}
    seals: dict[str, str] = {}
    rows["open"], truth = _split(out, "open", np.random.default_rng([seed, 1]), each, told)
    salt = f"open split of seed {seed}"
    seals["open"] = salted_sha256(truth_text(truth), salt)
    write_text(out / OPEN_TRUTH, json.dumps({"salt": salt, "truth": truth}, indent=1, sort_keys=True) + "\n")
    if sealed_truth is not None:
        random = np.random.default_rng(secrets.randbits(128))
        rows["sealed"], truth = _split(out, "sealed", random, each, told)
        salt = secrets.token_hex(32)
        seals["sealed"] = salted_sha256(truth_text(truth), salt)
        sealed_truth.parent.mkdir(parents=True, exist_ok=True)
        write_text(sealed_truth, json.dumps({"salt": salt, "truth": truth}, indent=1, sort_keys=True) + "\n")
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
    return Made(out, {name: len(part) for name, part in rows.items()}, sealed_truth)


def _split(
    out: Path, split: str, random: np.random.Generator, each: int, told: _Drawn
) -> tuple[list[dict[str, Any]], dict[str, Any]]:
    """Play and write one split; return the rows of its index and its truth."""
    (out / split).mkdir()
    rows: list[dict[str, Any]] = []
    trials, faults = {}, {}
    specimens = [draw_specimen(name, random, told.scene) for name in SPECIMENS]
    number = 0
    for specimen in specimens:
        bench = SpecimenBench(specimen)
        for condition in CONDITIONS:
            told.say(f"{split}: specimen {specimen.name}, {condition.name}")
            for k in range(each):
                number += 1
                part = "test" if k == each - 1 else "train"
                fault = str(random.choice(FAULTS)) if random.random() < FAULT_SHARE else ""
                played = bench.play(number, condition, fault, random)
                facts = {**played.trial.facts, "specimen": specimen.name, "part": part, "title": f"{split} {number}"}
                file = f"{split}/trial_{number:04d}.nc"
                write_netcdf(out / file, replace(played.trial, facts=facts))
                row = {"file": file, "trial": number, "specimen": specimen.name, "condition": condition.name,
                       "part": part}  # fmt: skip
                if told.films and not k and specimen is specimens[0] and condition.name in LEVELS:
                    film = f"{split}/trial_{number:04d}_film.tif"
                    n, first_s = write_film(out / film, played, specimen.seed + number)
                    row |= {"film": film, "film_frames": n, "film_first_s": first_s}
                rows.append(row)
                trials[str(number)] = played.truth
                if fault:
                    faults[str(number)] = fault
        bench.close()
    return rows, {"specimens": [asdict(one) for one in specimens], "trials": trials, "faults": faults}
