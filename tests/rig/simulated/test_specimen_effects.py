"""The specimen with a key that lifts and a shank that bends: it is off unless asked for."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from rig import load_rig, open_backend
from rig.simulated.backend import DEFAULT_BENCH
from rig.simulated.bench.plant import ActionPlant, load_plant


def test_the_default_specimen_has_no_effects() -> None:
    plant = load_plant(DEFAULT_BENCH, None, 5000.0)
    assert plant.choice.effects == ("motor_arm",)
    assert plant.advance(np.zeros(3)).key_lift_m is None


def test_a_specimen_in_a_scene_has_what_the_bench_adds(monkeypatch) -> None:
    monkeypatch.setattr(ActionPlant, "start_trial", lambda self, trial: None)  # compiles the scene
    plant = open_backend("sim://?scene=compliant-tip&effects=shank", load_rig("virtual").config).plant
    assert isinstance(plant, ActionPlant) and plant.choice.effects == ("motor_arm", "shank")
    assert plant.action["motor_arm.contact_c"] == 4.0e3  # of the scene; the bench has a stiffer one
    assert plant.action.scene == {"effects": ("motor_arm", "shank")}


def test_bench_tables_switch_effects_on_with_their_values(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr(ActionPlant, "start_trial", lambda self, trial: None)  # compiles the scene
    path = tmp_path / "bench.toml"
    table = "[shank]\nfrequency_hz = 110.0\n\n[motor]\n"
    path.write_text(DEFAULT_BENCH.read_text(encoding="utf-8").replace("[motor]\n", table, 1), encoding="utf-8")
    plant = load_plant(path, None, 5000.0, ("balance_rail",))
    assert set(plant.choice.effects) == {"motor_arm", "balance_rail", "shank"}
    assert plant.action["shank.frequency_hz"] == 110.0 and plant.action["motor_arm.inertia"] == 2.2e-4
