"""``calibrate contact``: a pad on a drum brakes the swings, and the action written has the specimen's friction."""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import model
import rig
from pianorig import workflows
from pianorig.commands.calibrate_contact import PadOrder, contact_friction
from tests.command_line import run

PAD = ("--load", 0.1, "--u-load", 0.0005, "--radius", 0.012, "--u-radius", 2e-5, "--swings", 2)


def test_the_action_written_has_the_friction_of_the_specimens_pair(tmp_path: Path, capsys: Any) -> None:
    out = tmp_path / "pair.toml"
    assert (
        run(
            "calibrate",
            "contact",
            "--contact",
            "contact04",
            *PAD,
            "--out",
            out,
            "--figure",
            figure := tmp_path / "pair.svg",
        )
        == 0
    )
    assert "contact04: friction 0.36" in capsys.readouterr().out
    assert "coefficient of friction" in figure.read_text("utf-8")
    found = model.load_action(out).quantities["contact04.friction.A"]
    assert abs(found.value - 0.36) < 3 * found.u < 0.05 * 0.36  # bench.toml
    record = tomllib.loads((tmp_path / "pair.pad.toml").read_text("utf-8"))
    assert record["kind"] == "pad" and len(record["found"]["shares_with"]) == 2
    assert run("calibrate", "contact", "--contact", "contact04", *PAD, "--out", out) == 2
    assert "exists already" in capsys.readouterr().err


def test_what_the_pad_cannot_tell_is_one_line(tmp_path: Path, capsys: Any) -> None:
    out = tmp_path / "pair.toml"
    assert run("calibrate", "contact", "--contact", "contact02", *PAD, "--out", out) == 2
    assert "has friction at contact01, contact04" in capsys.readouterr().err
    small = ("--load", 0.1, "--radius", 0.002, "--swings", 2)
    assert run("calibrate", "contact", "--contact", "contact04", *small, "--out", out) == 2
    assert "take a larger drum" in capsys.readouterr().err
    light = ("--load", 1e-4, "--radius", 0.012, "--swings", 2)
    assert run("calibrate", "contact", "--contact", "contact04", *light, "--out", out) == 2
    assert "put more weight on it" in capsys.readouterr().err and not out.exists()


def measured_off(contact: str, planted: float, seed: int, **stated: float) -> float:
    """Error over u of a calibration whose pad and drum are not quite what they are said to be."""
    order = PadOrder(contact, u_load_n=0.001, u_radius_m=1e-4, swings=2, **stated)
    chance = np.random.default_rng(seed)
    load = order.load_n + order.u_load_n * chance.standard_normal()
    radius = order.radius_m + order.u_radius_m * chance.standard_normal()
    rig_file, found = rig.load_rig("virtual"), []
    for pad in ("", f"{contact}:{load!r}:{radius!r}"):
        address = f"sim://?seed={seed}&swing=hammer{f'&pad={pad}' if pad else ''}"
        found.append(workflows.read_swings(rig_file, address, "hammer", 2, print, how="not asked"))
    facts = contact_friction(order, model.load_action("hirschkorn2004"), *found)
    assert facts["u_from_swings"] < facts["u_friction"] < 0.05 * facts["friction"]
    return float((facts["friction"] - planted) / facts["u_friction"])


def test_what_is_wrong_about_the_pad_is_in_the_uncertainty() -> None:
    assert abs(measured_off("contact10", 0.28, 4, load_n=0.1, radius_m=0.014)) < 3


def test_weights_known_to_nothing_are_refused(tmp_path: Path, refused: Callable[..., None]) -> None:
    pad = ("--load", "0.1", "--u-load", "inf", "--radius", "0.012")
    refused("finite", "calibrate", "contact", "--contact", "contact04", *pad, "--out", tmp_path / "a.toml")
