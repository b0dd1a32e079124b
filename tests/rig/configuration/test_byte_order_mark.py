"""TOML files saved with a byte-order mark, as Notepad and PowerShell do, are read as those without."""

from __future__ import annotations

import codecs
import shutil
from pathlib import Path

import model
import rig
from tests.command_line import run
from tests.rig.foreign.test_other_programs import MAPPING, TIME

ROOT = Path(rig.__file__).parents[1]
MARK = codecs.BOM_UTF8
PLAN = """schema = "piano-action-rig plan 1"
name = "one level"
order = "listed"
rest_s = 0.5

[[conditions]]
name = "forte"
profile = "forte"
repeats = 2
"""


def marked(source: Path, folder: Path) -> Path:
    """A copy of a file with the mark."""
    copy = folder / source.name
    copy.write_bytes(MARK + source.read_bytes())
    return copy


def test_rig_profile_and_action_files(tmp_path: Path) -> None:
    device = ROOT / "rig/rigs/virtual.toml"
    assert rig.load_rig(marked(device, tmp_path)).config == rig.load_rig(device).config
    profile = next((ROOT / "rig").rglob("forte.toml"))
    assert rig.load_profile(marked(profile, tmp_path)).name == "forte"
    action = next((ROOT / "model/actions").glob("*.toml"))
    assert model.load_action(marked(action, tmp_path))["key.pivot.x"] == model.load_action(action.stem)["key.pivot.x"]


def test_plan_mapping_session_and_scene_files(tmp_path: Path) -> None:
    plan, mapping, recording = tmp_path / "plan.toml", tmp_path / "lab.toml", tmp_path / "a.csv"
    plan.write_bytes(MARK + PLAN.encode())
    assert {entry.condition for entry in rig.load_plan(plan).entries} == {"forte"}
    mapping.write_bytes(MARK + MAPPING.format(more="", time=TIME, key="").encode())
    rows = "".join(f"{k / 5000:.4f},{max(0, k - 200) / 50},0,0\n" for k in range(600))
    recording.write_text(f"time_s,force_n,key,hammer\n{rows}")
    out = tmp_path / "s"
    assert run("import", recording, "--mapping", mapping, "--out", out) == 0
    # the session keeps the mapping as it was; its own file may be saved with a mark too
    assert (out / "mapping.toml").read_bytes().startswith(MARK)
    marked_session = shutil.copytree(out, tmp_path / "t")
    (marked_session / "session.toml").write_bytes(MARK + (out / "session.toml").read_bytes())
    assert run("info", marked_session) == 0
    assert rig.open_session(marked_session)[1].read().has_force
    scene = tmp_path / "scene.toml"
    scene.write_bytes(MARK + b'effects = ["balance_rail"]\n')
    assert model.choice_of(model.load_action(), str(scene)).effects
