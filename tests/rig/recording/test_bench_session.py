"""The recorder on the whole virtual bench: what is read agrees with the truth within what the bench file declares.

A camera that runs by itself: its exposures are counted on the AI clock and tell when each frame was taken.

Further voltage inputs: each reads its own terminal in its own unit, through journal, recovery and sealed file.

A session over several cards: one clock, told apart from two; a missing cable or wire is named.
"""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from nidaqmx.errors import DaqError

import rig
from pianorig.workflows import rehearse
from rig import (
    HardwareFault,
    InputError,
    RigError,
    Session,
    load_profile,
    load_rig,
    open_backend,
    parse_rig,
)
from rig import (
    record as record_session,
)
from rig import (
    recover as recover_session,
)
from rig.daq.task_plan import recording_plan
from rig.session.journal_writer import JournalWriter
from rig.session.live_view import SessionFollower
from rig.session.sealed_trial import read_trial, write_trial
from rig.session.trial_head import FrameClock
from rig.simulated.backend import CAMERA_CLOCK_ERROR, DEFAULT_BENCH
from rig.simulated.bench.sensors import load_sensors
from tests.rig.fuzz.stored_cases import journal_in
from tests.rig.lab_channels import READBACK


@pytest.fixture
def record_steps(record_steps, make_backend):
    """Record on the virtual device."""

    def record(rig: Any, name: str = "s", **changes: Any) -> Session:
        changes.setdefault("backend", make_backend(rig.config, noise_n=0.02))
        return record_on_fake(rig, name, **changes)

    record_on_fake = record_steps
    return record


@pytest.fixture(scope="module")
def forte(tmp_path_factory):
    """Two forte trials and the truth of each."""
    rig = load_rig("virtual")
    backend = open_backend("sim://?seed=11", rig.config)
    truths = []
    folder = tmp_path_factory.mktemp("bench") / "forte"
    record_session(
        folder, rig_config=rig, backend=backend, trials=2, after_trial=lambda t: truths.append(backend.plant.truth())
    )
    backend.close()
    return [(trial, trial.read(), truth) for trial, truth in zip(Session.open(folder).trials, truths, strict=True)]


def test_the_encoders_tell_the_true_angles_within_one_count_and_their_budget(forte) -> None:
    sensors = load_sensors(DEFAULT_BENCH).encoders
    for _, data, truth in forte:
        angle = truth.angles_at(data.time_s)[:, [0, 1, 4]]
        one_count = 2 * np.pi / np.array([e.counts_per_revolution for e in data.encoders])
        error = data.angle_rad - (angle - angle[0])
        planted = [
            2 * s.interpolation_rad + s.eccentricity_rad * np.ptp(angle[:, i]) + 3 * s.pivot_shift_rad
            for i, s in enumerate(sensors)
        ]
        # the truth is looked up between edges, hence the small margin at the fastest moment
        assert np.all(np.abs(error).max(axis=0) < 1.05 * one_count + planted)
        for i, (encoder, s) in enumerate(zip(data.encoders, sensors, strict=True)):
            # the rig file states what the bench has: a sine's standard deviation, and each error is inside the budget
            assert encoder.u_interpolation_rad == pytest.approx(s.interpolation_rad / np.sqrt(2), rel=0.02)
            assert encoder.u_eccentricity_rad == pytest.approx(s.eccentricity_rad / np.sqrt(2), rel=0.02)
            assert encoder.u_pivot_shift_rad == s.pivot_shift_rad
            turned = angle[:, i] - angle[0, i]
            u = np.sqrt(encoder.u_change_rad**2 + (encoder.u_turn_relative * turned) ** 2 + one_count[i] ** 2 / 6)
            assert np.all(np.abs(error[:, i]) < 4 * u)


def test_the_force_is_the_true_one_delayed_with_the_declared_gain_offset_hum_and_noise(forte) -> None:
    for _, data, truth in forte:
        later = np.interp(data.time_s - data.force_info.group_delay_s, truth.time_s, truth.force_n)
        cell = load_sensors(DEFAULT_BENCH).force
        phase = 2 * np.pi * cell.hum_hz * data.time_s
        columns = [later, np.ones_like(later), *(f(k * phase) for k in (1, 3) for f in (np.sin, np.cos))]
        fit, *_ = np.linalg.lstsq(np.column_stack(columns), data.raw_force_n, rcond=None)
        assert fit[0] == pytest.approx(1 + cell.gain_error, abs=2e-4)
        assert fit[1] == pytest.approx(cell.offset_n, abs=4 * cell.offset_scatter_n)
        assert np.hypot(*fit[2:4]) == pytest.approx(cell.hum_n[0], abs=0.003)
        assert np.hypot(*fit[4:6]) == pytest.approx(cell.hum_n[2], abs=0.003)
        residual = data.raw_force_n - np.column_stack(columns) @ fit
        assert residual.std() == pytest.approx(cell.noise_n, rel=0.05)
        assert data.force_info.u_noise_n == cell.noise_n  # the rig file states what the bench has


def test_the_motor_was_told_what_the_profile_says(forte) -> None:
    _, data, _ = forte[0]
    start = int(round(0.35 * 5000))
    wanted = load_profile("forte").sample(5000) / 12
    np.testing.assert_array_equal(data.motor_command_v[start : start + wanted.size], wanted)
    assert not data.motor_command_v[:start].any() and not data.motor_command_v[start + wanted.size :].any()


COUNTED = (('mode = "pulses"', 'mode = "counted"'), ('terminal = "/cDAQ1Mod4/PFI4"', 'terminal = "/cDAQ1Mod4/PFI0"'))


@pytest.mark.parametrize("armed", ["by the start trigger", "before it"])
def test_counted_exposures_give_the_frame_times_within_their_uncertainty(
    armed, edited_rig, make_backend, record_steps
) -> None:
    rig = edited_rig(*COUNTED)
    if armed == "before it":
        rig = parse_rig(load_rig("chassis_and_card").text.replace("u_time_s = 1.0e-4", "u_time_s = 1.0e-6"))
    truths = []
    backend = make_backend(rig.config, noise_n=0.02)
    note = {"after_trial": lambda trial: truths.append(backend.device.bench.exposures)}
    session = record_steps(rig, backend=backend, trials=2, **note)
    for trial, true in zip(session.trials, truths, strict=True):
        data = trial.read()
        assert true.rate_hz == pytest.approx(2000 * (1 + CAMERA_CLOCK_ERROR), rel=1e-12)
        assert data.camera.n_frames == true.count_edges(data.time_s[-1:])[0]
        real = true.first_s + np.arange(data.camera.n_frames) / true.rate_hz + data.camera.exposure_s / 2
        error = data.camera.frame_time_s - real
        assert data.camera.u_time_s < 4e-5 and np.abs(error).max() < np.sqrt(3) * data.camera.u_time_s
    assert truths[0].first_s != truths[1].first_s


def test_too_few_exposures_are_no_frame_clock_and_a_line_is_fitted_exactly() -> None:
    clock = FrameClock(1000.0, 0.0, 2e-4, 0.0, counted=True)
    time_s = np.arange(1000) / 5000
    assert clock.frames_counted(time_s, np.zeros(1000, dtype=np.int64)) is None
    # an exposure at 0.37 of every third sample interval, from sample 4 on
    count = np.maximum((np.arange(1000) - 4) // 3 + 1, 0)
    found = clock.frames_counted(time_s, count)
    assert found.frame_rate_hz == pytest.approx(5000 / 3, rel=1e-6)
    assert found.first_frame_time_s == pytest.approx(3.5 / 5000 + 1e-4, abs=1e-7)
    assert found.u_time_s == pytest.approx(1e-4 / np.sqrt(3), rel=0.01)  # the phase within a sample stays unknown
    early = clock.frames_counted(time_s, (np.arange(1000) + 1) // 3 + 152)  # counted since before the first sample
    assert early.first_frame_time_s == pytest.approx((1.5 - 3 * 152) / 5000 + 1e-4, abs=1e-7)
    jumps = count + (np.arange(1000) > 500) * (count > 0)
    assert clock.frames_counted(time_s, jumps) is None  # a frame that was counted twice fits no line
    assert found.n_frames == count[-1]


def test_a_camera_without_a_free_counter_is_refused(edited_rig, tmp_path) -> None:
    with pytest.raises(InputError, match="one task per counter"):
        edited_rig(*COUNTED, ("Mod4/ctr3", "Mod4/ctr2"))
    fifth = edited_rig(*COUNTED, ("Mod4/ctr3", "Mod4/ctr4"))  # a chassis has four
    (tmp_path / "rig.toml").write_text(fifth.text)
    with pytest.raises(HardwareFault, match="ctr4: no such channel"):
        rehearse("forte", str(tmp_path / "rig.toml"), "sim://")
    with pytest.raises(InputError, match="allowed at most 2500 Hz"):
        edited_rig(*COUNTED, ("frame_rate_hz = 2000.0", "frame_rate_hz = 4000.0"))
    counted = edited_rig(*COUNTED)
    (tmp_path / "rig.toml").write_text(counted.text)
    tasks = rehearse("forte", str(tmp_path / "rig.toml"), "sim://")["tasks"]
    (row,) = [row for row in tasks if row["task"] == "exposures"]
    assert row["channel"] == "cDAQ1Mod4/ctr3" and row["routes"] == ("/cDAQ1Mod4/PFI0 -> counter source",)
    assert row["clock"].startswith("/cDAQ1/ai/SampleClock")


OPEN = READBACK.replace("motor_readback", "drive_current").replace("ai1", "ai2").replace('unit = "N"', 'unit = "A"')
OPEN = OPEN.replace("[3.0, 27.0]", "[-1.5, 4.5]").replace("60.0", "20.0")


def rig_with(*tables: str, change: tuple[str, str] = ("", "")) -> Any:
    return parse_rig(load_rig("pcie6363").text.replace(*change) + "".join(tables), "lab.toml")


@pytest.fixture
def wired() -> Any:
    return rig_with(OPEN, READBACK)


def test_each_channel_reads_its_own_terminal_in_its_unit(wired, record_steps) -> None:
    session = record_steps(wired)
    data = session.trials[0].read()
    assert [c.name for c in data.channels] == ["drive_current", "motor_readback"]
    current, readback = data.channel_values.T
    np.testing.assert_array_equal(current, np.full(data.n_valid, -1.5))  # nothing is wired there: 0 V
    held = np.concatenate(([0.0], data.motor_command_v[:-1]))
    np.testing.assert_allclose(readback, 3.0 + 12.0 * held, atol=12 * 10 / 2**15)
    assert np.ptp(readback) > 5.9
    table = data.to_frame()
    np.testing.assert_array_equal(table["motor_readback"], readback)
    np.testing.assert_array_equal(table["drive_current"], current)
    with h5py.File(session.trials[0].path) as file:
        found = file["daq/motor_readback"]
        assert found.attrs["units"] == "N" and found.attrs["sensor"] == "wire from ao0"
        assert found.dims[0][0].name == "/daq/time"


def test_force_and_counts_are_the_same_with_and_without_them(wired, record_steps) -> None:
    used = {"with": wired, "without": load_rig("pcie6363")}
    trials = [record_steps(rig, name).trials[0].read() for name, rig in used.items()]
    for name in ("raw_force_n", "force_raw", "encoder_count", "motor_command_v"):
        np.testing.assert_array_equal(getattr(trials[0], name), getattr(trials[1], name))
    assert trials[1].channels == () and trials[1].channel_values is None


def test_a_recording_cut_off_is_recovered_with_them(wired, record_steps, tmp_path) -> None:
    seen: list[Any] = []

    class Keeping(JournalWriter):
        def remove(self) -> None:
            seen.extend(journal_in(self.path.read_bytes())[1])

    counted = rig_with(OPEN, READBACK, change=('mode = "pulses"', 'mode = "counted"'))
    counted = parse_rig(counted.text.replace('terminal = "/Dev1/PFI15"', 'terminal = "/Dev1/PFI12"'), "lab.toml")
    for name, used in (("pulses", wired), ("counted", counted)):
        folder, session = tmp_path / name, record_steps(used, name, open_journal=Keeping)
        sealed = session.trials[0].read()
        followed = SessionFollower(folder).poll()
        assert followed is not None and followed.raw_force_n.size == sealed.n_valid
        session.trials[0].path.unlink()
        recover_session(folder)
        again = Session.open(folder).trials[0].read()
        np.testing.assert_array_equal(again.channel_values, sealed.channel_values)
        np.testing.assert_array_equal(again.encoder_count, sealed.encoder_count)
        assert again.camera == sealed.camera and again.channels == sealed.channels
        assert np.ptp(again.channel_values[:, 1]) > 5.9
        assert (seen[-1].exposure_count is not None) == (name == "counted")


def test_a_trial_whose_values_do_not_fit_its_channels_is_not_written(wired, record_steps, tmp_path) -> None:
    data = record_steps(wired).trials[0].read()
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


STEP = Path(__file__).parents[1] / "step.toml"


@pytest.mark.parametrize("name", ["thesis", "chassis_and_card"])
def test_a_session_over_several_cards_is_that_of_one(tmp_path: Path, name: str) -> None:
    alone = rig.record(tmp_path / "one", profile="forte", trials=1).trial(1).read()
    trial = rig.record(tmp_path / "several", profile="forte", trials=1, rig_config=name).trial(1)
    several = trial.read()
    assert trial.status == "complete" and several.sample_rate_hz == alone.sample_rate_hz
    n = min(alone.n_valid, several.n_valid) - 60
    np.testing.assert_allclose(several.encoder_count[:n], alone.encoder_count[:n], atol=2)
    felt = []
    for data in (alone, several):  # each at the time it was felt, 8 ms and 0.04 ms before its sample
        at = data.time_s[:n] + data.force_info.group_delay_s
        felt.append(np.interp(at, data.time_s, data.raw_force_n))
    noise = 8 * 0.02 + 0.06  # of both cells, the hum between them, the converter's step
    assert np.abs(felt[0] - felt[1])[200:].max() < noise + 0.02 * alone.raw_force_n.max()


def test_a_cable_that_is_not_registered_is_named_and_nothing_is_left(tmp_path: Path, bench_with) -> None:
    with pytest.raises(rig.HardwareFault, match=r"no RTSI cable joins the devices.* -89125"):
        rig.record(tmp_path / "s", profile=STEP, rig_config="thesis", backend=bench_with("rtsi = false"))
    assert not (tmp_path / "s").exists()


def test_a_wire_that_is_missing_is_found_by_the_encoder_that_gives_no_samples(tmp_path: Path, bench_with) -> None:
    with pytest.raises(rig.ReadTimeout, match="encoder_key"):
        rig.record(tmp_path / "s", profile=STEP, rig_config="chassis_and_card", backend=bench_with("wires = false"))


@pytest.mark.parametrize(
    ("name", "old", "new", "said"),
    [
        ("thesis", 'link = "RTSI"', 'link = "own"', "devices[0].link = 'own'"),
        ("thesis", 'name = "Dev3"', 'name = "Dev2"', "each needs a name of its own"),
        ("thesis", 'link = "RTSI"', 'link = "lines"', "needs clock_from and clock_to, the ends of the wire"),
        ("thesis", 'channel = "SC1Mod1/ai0"', 'channel = "Dev3/ai0"', "force and further channels give the clock"),
        ("thesis", 'counter = "Dev1/ctr0"', 'counter = "Dev2/ctr4"', "run on its own timebase"),
        ("chassis_and_card", 'clock_to = "/Dev1/PFI5"', 'clock_to = "/Dev2/PFI5"', "allowed a terminal of Dev1"),
        ("chassis_and_card", 'clock_from = "/cDAQ1Mod4/PFI5"', 'clock_from = "/Dev1/PFI6"', "a terminal of cDAQ1"),
        ("chassis_and_card", 'line = "cDAQ1Mod4/port0/line7"', 'line = "Dev1/port0/line0"', "whose watchdog it is"),
    ],
)
def test_a_rig_file_whose_devices_cannot_work_together_is_refused(name: str, old: str, new: str, said: str) -> None:
    text = rig.load_rig(name).text
    assert old in text
    with pytest.raises(rig.RigInputError, match=re.escape(said)):
        rig.parse_rig(text.replace(old, new))


def test_a_trial_file_says_by_itself_where_it_comes_from(record_steps, tmp_path) -> None:
    rig, folder = load_rig("virtual"), tmp_path / "s"
    record_steps(rig, operator="ana", action_name="Boston")
    said = Session.open(folder).trials[0].read().provenance
    assert (said["operator"], said["action"], said["rig_sha256"]) == ("ana", "Boston", rig.sha256)
    assert said["calibration_date_force"] == "2026-01-15" and said["profile"] == "step"
    assert said["backend_client"].startswith("nidaqmx") and said["software_python"] and said["device"] == "cDAQ1"
    with h5py.File(folder / "trial_0001.h5") as file:
        codes = file["daq/force_code"][()]
        assert (np.abs(codes) < 2**23).all() and np.unique(codes).size > 100  # each is whole on the virtual bridge
        scaling = file["daq/force"].attrs["device_scaling"]
        np.testing.assert_allclose(codes * scaling[1] * 1e3, file["daq/force_raw"][()], atol=1e-12)


def test_a_client_that_is_called_wrongly_is_an_error_of_the_program(record_steps, monkeypatch) -> None:
    rig = load_rig("virtual")

    def misshapen(*arguments: object) -> None:
        raise DaqError("Read cannot be performed because the NumPy array is not shaped correctly", -1)

    monkeypatch.setattr("nidaqmx.stream_readers.CounterReader.read_many_sample_double", misshapen)
    with pytest.raises(RigError, match="called wrongly during read") as caught:
        record_steps(rig)
    assert caught.value.exit_code == 1 and not isinstance(caught.value, HardwareFault)
