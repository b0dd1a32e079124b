"""The sim:// address: options checked, clock as asked for, the whole bench behind it."""

from __future__ import annotations

import numpy as np
import pytest

import model
from rig import InputError, open_backend
from rig.simulated.bench.clock import VirtualClock
from rig.simulated.bench.plant import ActionPlant


@pytest.mark.parametrize(
    ("url", "said"),
    [
        ("sim://?sed=3", "options bench, seed, clock"),
        ("sim://host", "allowed is sim://"),
        ("sim://?seed=1&seed=2", "each once"),
        ("sim://?seed=-1", "allowed a whole number"),
        ("sim://?seed=1.5", "allowed a whole number"),
        ("sim://?clock=fast", "allowed virtual, real, or a speed"),
        ("sim://?clock=nan", "allowed virtual, real, or a speed"),
        ("sim://?bench=/no/such/bench.toml", "does not exist"),
        ("sim://?felt=block&swing=hammer", "one of felt, swing and pose"),
        ("sim://?swing=key&pose=key:0,0.01", "one of felt, swing and pose"),
        ("sim://?pad=contact04:0.2:0.005", "pad beside swing"),
        ("sim://?swing=key&pad=contact04:nan:0.005", "allowed CONTACT:LOAD_N:RADIUS_M"),
        ("sim://?pose=key:0,nan", "allowed as in key:0,0.01,0.02"),
        ("sim://?fault=reserved@TaskControll%231", "TaskControll: no call"),
        ("sim://?effects=rail", "effects: found 'rail', allowed balance_rail, shank, motor_arm"),
        ("sim://?effect=shank", "with the options bench, seed, clock, fault, scene, effects"),
        ("sim://?scene=strung", r"scene 'strung': not found; did you mean string\?"),
        ("sim://?scene=finger", "found finger and motor_arm, allowed one of them on the key"),
        ("sim://?scene=key-whippen", "scene: found one without hammer, jack, repetition, allowed one with all bodies"),
    ],
)
def test_bad_options_are_refused(url, said, config) -> None:
    with pytest.raises((InputError, model.InputError), match=said):
        open_backend(url, config)


def test_a_felt_of_another_law_is_not_pressed_by_the_usual_one(config, tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(ActionPlant, "start_trial", lambda self, trial: None)  # compiles the scene
    scene = tmp_path / "scene.toml"
    scene.write_text('[contact02]\nlaw = "hysteresis"\n', "utf-8")
    with pytest.raises(InputError, match="felt contact02: follows the law hysteresis, allowed hunt-crossley"):
        open_backend(f"sim://?felt=contact02&scene={scene.as_posix()}", config)


def test_the_whole_bench_records_a_blow_and_the_seed_decides_the_scatter(config, begin) -> None:
    command = np.concatenate((np.zeros(250), np.full(100, 0.3), np.zeros(1)))
    records = []
    for seed in (3, 3, 4):
        backend = open_backend(f"sim://?seed={seed}", config)
        assert backend.capabilities.simulated and backend.capabilities.description["seed"] == str(seed)
        begin(backend, command=command)
        block = backend.read_block(600, 1.0)
        records.append((block.force_n, block.encoder_count))
        backend.close()
    np.testing.assert_array_equal(records[0][0], records[1][0])
    assert not np.array_equal(records[0][0], records[2][0])
    assert records[0][0].max() > 1.0 and np.abs(records[0][1]).max(axis=0).min() > 10


def test_the_device_s_time_is_that_of_the_samples_read(make_backend, config, begin) -> None:
    clock = VirtualClock()
    backend = make_backend(config, clock=clock)
    begin(backend)
    assert clock.now_s == 0.0
    backend.read_block(300, 1.0)
    assert clock.now_s == pytest.approx(0.06)
