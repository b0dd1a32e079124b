"""Further voltage inputs: each reads its own terminal in its own unit, through journal, recovery and sealed file."""

from __future__ import annotations

import re
from typing import Any

import h5py
import numpy as np
import pytest

from rig.configuration.rig_file import load_rig, parse_rig
from rig.daq.task_plan import recording_plan
from rig.errors import InputError
from rig.recording.recorder import record_session
from rig.recording.recover import recover_session
from rig.session import Session
from rig.session.journal.format import read_journal
from rig.session.journal.live_reader import SessionFollower
from rig.session.journal.writer import JournalWriter
from rig.session.trial_file import read_trial, write_trial
from tests.rig.lab_channels import READBACK

OPEN = READBACK.replace("motor_readback", "drive_current").replace("ai1", "ai2").replace('unit = "N"', 'unit = "A"')
OPEN = OPEN.replace("[3.0, 27.0]", "[-1.5, 4.5]").replace("60.0", "20.0")


def rig_with(*tables: str, change: tuple[str, str] = ("", "")) -> Any:
    return parse_rig(load_rig("pcie6363").text.replace(*change) + "".join(tables), "lab.toml")


@pytest.fixture
def rig() -> Any:
    return rig_with(OPEN, READBACK)


def test_each_channel_reads_its_own_terminal_in_its_unit(rig, make_backend, step_profile, tmp_path) -> None:
    backend = make_backend(rig.config)
    session = record_session(tmp_path / "s", profile=step_profile, rig_config=rig, backend=backend, trials=1)
    data = session.trials[0].read()
    assert [c.name for c in data.channels] == ["drive_current", "motor_readback"]
    current, readback = data.channel_values.T
    np.testing.assert_array_equal(current, np.full(data.n_valid, -1.5))  # nothing is wired there: 0 V
    held = np.concatenate(([0.0], data.motor_command_v[:-1]))
    np.testing.assert_allclose(readback, 3.0 + 12.0 * held, atol=12 * 10 / 2**15)
    assert np.ptp(readback) > 5.9
    table = data.to_table()
    np.testing.assert_array_equal(table["motor_readback"], readback)
    np.testing.assert_array_equal(table["drive_current"], current)
    with h5py.File(session.trials[0].path) as file:
        found = file["daq/motor_readback"]
        assert found.attrs["units"] == "N" and found.attrs["sensor"] == "wire from ao0"
        assert found.dims[0][0].name == "/daq/time"


def test_force_and_counts_are_the_same_with_and_without_them(rig, make_backend, step_profile, tmp_path) -> None:
    trials = []
    for name, used in (("with", rig), ("without", load_rig("pcie6363"))):
        session = record_session(
            tmp_path / name, profile=step_profile, rig_config=used, backend=make_backend(used.config), trials=1
        )
        trials.append(session.trials[0].read())
    for name in ("force_n", "force_raw", "encoder_count", "motor_command_v"):
        np.testing.assert_array_equal(getattr(trials[0], name), getattr(trials[1], name))
    assert trials[1].channels == () and trials[1].channel_values is None


def test_a_recording_cut_off_is_recovered_with_them(rig, make_backend, step_profile, tmp_path) -> None:
    seen: list[Any] = []

    class Keeping(JournalWriter):
        def remove(self) -> None:
            seen.append(read_journal(self.path))

    counted = rig_with(OPEN, READBACK, change=('mode = "pulses"', 'mode = "counted"'))
    counted = parse_rig(counted.text.replace('terminal = "/Dev1/PFI15"', 'terminal = "/Dev1/PFI12"'), "lab.toml")
    for name, used in (("pulses", rig), ("counted", counted)):
        folder = tmp_path / name
        session = record_session(
            folder, profile=step_profile, rig_config=used, backend=make_backend(used.config), trials=1,
            open_journal=Keeping,
        )  # fmt: skip
        sealed = session.trials[0].read()
        followed = SessionFollower(folder).poll()
        assert followed is not None and followed.force_n.size == sealed.n_valid
        session.trials[0].path.unlink()
        recover_session(folder)
        again = Session.open(folder).trials[0].read()
        np.testing.assert_array_equal(again.channel_values, sealed.channel_values)
        np.testing.assert_array_equal(again.encoder_count, sealed.encoder_count)
        assert again.channels == sealed.channels and np.ptp(again.channel_values[:, 1]) > 5.9
        assert (seen[-1].blocks[0].exposure_count is not None) == (name == "counted")


def test_a_trial_whose_values_do_not_fit_its_channels_is_not_written(rig, make_backend, step_profile, tmp_path) -> None:
    from dataclasses import replace

    session = record_session(
        tmp_path / "s", profile=step_profile, rig_config=rig, backend=make_backend(rig.config), trials=1
    )
    data = session.trials[0].read()
    for wrong in (data.channel_values[:-1], data.channel_values[:, :1], None):
        with pytest.raises(InputError, match="channel_values has shape"):
            write_trial(tmp_path / "trial_0002.h5", replace(data, number=2, channel_values=wrong))
    write_trial(tmp_path / "trial_0003.h5", replace(data, number=3, channels=(), channel_values=None))
    assert read_trial(tmp_path / "trial_0003.h5").channels == ()


@pytest.mark.parametrize(
    ("table", "said"),
    [
        (READBACK.replace("motor_readback", "force"), "channel name 'force' is taken"),
        (READBACK.replace("motor_readback", "hammer_rad"), "channel name 'hammer_rad' is taken"),
        (READBACK.replace("motor_readback", "Motor"), "name"),
        (READBACK.replace("Dev1/ai1", "dev1/AI0"), "inputs of force and channels .* repeat"),
        (READBACK + READBACK.replace("ai1", "ai5"), "names of force and channels .* repeat"),
        (READBACK.replace("[3.0, 27.0]", "[3.0, 3.0]"), "must differ"),
        (READBACK.replace("least = -60.0", "least = 60.0"), "allowed below most"),
        (READBACK.replace('unit = "N"', 'unit = ""'), "unit"),
    ],
)
def test_a_bad_table_is_refused_in_one_line(table, said) -> None:
    with pytest.raises(InputError, match=said) as refused:
        rig_with(table)
    assert "\n" not in str(refused.value)


def test_a_bridge_module_has_no_voltage_inputs() -> None:
    with pytest.raises(InputError, match="force.kind = 'bridge'"):
        parse_rig(load_rig("virtual").text + READBACK.replace("Dev1/ai1", "cDAQ1Mod1/ai1"), "lab.toml")


def test_the_example_in_the_rig_file_is_valid_and_the_dry_run_names_its_channels(make_backend, command) -> None:
    text = load_rig("pcie6363").text
    begin = text.index("# [[channels]]")
    end = text.index("[motor]", begin)
    example = re.sub(r"(?m)^# ?", "", text[begin:end])
    config = parse_rig(text[:begin] + example + text[end:], "lab.toml").config
    assert [c.name for c in config.channels] == ["drive_current", "key_acceleration"]
    backend = make_backend(config)
    rows = recording_plan(config, backend.configure(config, command), command.size)
    assert [(row.task, row.channel) for row in rows if "AI" in row.purpose] == [
        ("force", "Dev1/ai0"),
        ("force", "Dev1/ai2"),
        ("force", "Dev1/ai3"),
    ]
    reserved = [c.physical.name for c in backend.device.tasks["force"].channels]
    assert reserved == ["Dev1/ai0", "Dev1/ai2", "Dev1/ai3"]
