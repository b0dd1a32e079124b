"""Settings and records of every reader of TOML, each with what "right" means by a second, independent reading."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import numpy as np

import vision
from rig import InputError, load_profile, load_rig, parse_profile, parse_rig
from rig.foreign.mapping import parse_mapping
from rig.recording.trial_plan import parse_plan
from tests.rig.foreign.test_session_import import MAPPING
from tests.rig.fuzz.damage import Case, same_values, text
from vision import load_calibration


def _says(of: str = "") -> Any:
    """Right is what the text says, in the attribute of this name or in what was found itself."""
    return lambda data, found: same_values(tomllib.loads(data.decode()), getattr(found, of) if of else found)


def rig_case(folder: Path) -> Case:
    return load_rig("virtual").text.encode(), lambda data: parse_rig(text(data)), _says("config")


def profile_case(folder: Path) -> Case:
    return load_profile("piano").text.encode(), lambda data: parse_profile(text(data)), _profile_is_right


def _profile_is_right(data: bytes, found: Any) -> None:
    points = tomllib.loads(data.decode())["points"]
    np.testing.assert_array_equal(found.time_s, [point["time_s"] for point in points])
    np.testing.assert_array_equal(found.force_n, [point["force_n"] for point in points])
    assert np.all(np.isfinite(found.sample(5000.0))) and found.force_n[0] == found.force_n[-1] == 0


def plan_case(folder: Path) -> Case:
    whole = (
        "# a comment that says at some length what this plan is for, so that damage may also do no harm at all\n"
        'schema = "piano-action-rig plan 1"\nname = "p"\nseed = 7\nrest_s = 1.5\nwarm_up = 1\norder = "blocks"\n'
        '[[conditions]]\nname = "a"\nprofile = "forte"\nrepeats = 3\n'
        '[[conditions]]\nname = "b"\nprofile = "piano"\nrepeats = 2\nprompt = "x"\n[room]\ntemperature_c = 21.0\n'
    )

    def right(data: bytes, found: Any) -> None:
        plain = tomllib.loads(data.decode())
        count = plain.get("warm_up", 0) + sum(c.get("repeats", 1) for c in plain["conditions"])
        assert len(found.entries) == count and found.rest_s == plain.get("rest_s", 0)

    return whole.encode(), lambda data: parse_plan(text(data)), right


def mapping_case(folder: Path) -> Case:
    return MAPPING.encode(), lambda data: parse_mapping(text(data)), _says("config")


def _vision(load: Any, path: Path) -> Any:
    """The reader of a file of the vision package; its error as ours, so that one damage serves both."""

    def read(data: bytes) -> Any:
        path.write_bytes(data)
        try:
            return load(path)
        except vision.errors.InputError as error:
            raise InputError(str(error)) from error

    return read


def bodies_case(folder: Path) -> Case:
    whole = "".join(
        f'[[body]]\nname = "{name}"\nlayer = {k}\n{parent}'
        f"polygon_px = [[10.5, {9 + k}], [60, 12], [58.25, 41], [11, 40]]\n"
        for k, (name, parent) in enumerate((("whippen", ""), ("jack", 'parent = "whippen"\n')))
    )

    def right(data: bytes, found: Any) -> None:
        tables = tomllib.loads(data.decode())["body"]
        assert [(b.name, b.parent, b.layer) for b in found] == [
            (t["name"], t.get("parent"), t.get("layer", 0)) for t in tables
        ]
        for body, table in zip(found, tables, strict=True):
            np.testing.assert_array_equal(body.polygon_px, table["polygon_px"])

    return whole.encode(), _vision(vision.load_bodies, folder / "bodies.toml"), right


def camera_case(folder: Path) -> Case:
    values = [round(0.01 * (k + 1), 4) for k in range(5)]
    covariance = [[1e-6 * (i == k) for k in range(5)] for i in range(5)]
    whole = (
        "# measured with a printed target in the plane of motion, before the session and again after it\n"
        f"[camera]\nwidth_px = 640\nheight_px = 480\nparameters = {values}\ncovariance = {covariance}\n"
        "scale_px_per_m = 9000.5\nu_scale_px_per_m = 4.25\n"
    )

    def right(data: bytes, found: Any) -> None:
        table = tomllib.loads(data.decode())["camera"]
        assert (found.width, found.height) == (table["width_px"], table["height_px"])
        np.testing.assert_array_equal(found.parameters, table["parameters"])
        assert found.scale_px_per_m == table["scale_px_per_m"] and np.isfinite(found.scale_px_per_m)

    return whole.encode(), _vision(load_calibration, folder / "camera.toml"), right
