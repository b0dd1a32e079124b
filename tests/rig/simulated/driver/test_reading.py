"""What the virtual device hands over: order, timeouts, overwriting, units; seen through the real client."""

from __future__ import annotations

from typing import Any

import nidaqmx
import numpy as np
import pytest
from nidaqmx import constants as ni
from nidaqmx.errors import DaqReadError


@pytest.fixture
def force_task(bridge) -> Any:
    """Make a force task."""

    def make(cdaq: Any, samples: int = 1000, mode: Any = ni.AcquisitionType.CONTINUOUS) -> nidaqmx.Task:
        task = cdaq.task()
        bridge(task)
        task.timing.cfg_samp_clk_timing(5000, sample_mode=mode, samps_per_chan=samples)
        return task

    return make


def test_a_slave_started_after_the_master_has_missed_its_trigger(cdaq, encoder, force_task) -> None:
    force, counts = force_task(cdaq), cdaq.task()
    encoder(counts)
    counts.timing.cfg_samp_clk_timing(5000, source="/cDAQ1/ai/SampleClock", sample_mode=ni.AcquisitionType.CONTINUOUS)
    counts.triggers.arm_start_trigger.trig_type = ni.TriggerType.DIGITAL_EDGE
    counts.triggers.arm_start_trigger.dig_edge_src = "/cDAQ1/ai/StartTrigger"
    force.start()
    counts.start()
    force.read(100)
    with pytest.raises(DaqReadError) as late:
        counts.read(100, timeout=0.5)
    assert late.value.error_code == -200284


def test_a_read_that_times_out_hands_over_what_came_and_can_go_on(cdaq, force_task) -> None:
    force = force_task(cdaq)
    force.start()
    buffer = np.full(100, np.nan)
    reader = nidaqmx.stream_readers.AnalogSingleChannelReader(force.in_stream)
    with pytest.raises(DaqReadError) as late:
        reader.read_many_sample(buffer, 100, timeout=0.01)
    assert late.value.samps_per_chan_read == 50
    reader.read_many_sample(buffer, 100, timeout=0.02)
    assert force.in_stream.curr_read_pos == 150


def test_a_finite_acquisition_ends_and_is_read_to_its_end(cdaq, force_task) -> None:
    force = force_task(cdaq, 250, ni.AcquisitionType.FINITE)
    force.start()
    assert not force.is_task_done()
    assert len(force.read(ni_all := nidaqmx.constants.READ_ALL_AVAILABLE)) == 250 and ni_all == -1
    assert force.is_task_done()
    with pytest.raises(DaqReadError) as past:
        force.read(1, timeout=0.1)
    assert past.value.error_code == -200278


def test_asking_whether_a_task_is_done_lets_time_pass(cdaq, force_task) -> None:
    force = force_task(cdaq, 250, ni.AcquisitionType.FINITE)
    force.start()
    polls = next(k for k in range(1000) if force.is_task_done())
    assert polls == 50  # 1 ms each but the first
    force.stop()
    force.start()
    force.wait_until_done(timeout=0.05)
    force.stop()
    force.start()
    with pytest.raises(nidaqmx.errors.DaqError, match="-200474"):
        force.wait_until_done(timeout=0.049)


def test_the_bench_follows_whatever_rate_the_clock_has(cdaq, bridge) -> None:
    cdaq.device.lines["cDAQ1Mod4/port0/line7"] = True
    task = cdaq.task()
    bridge(task)
    task.timing.cfg_samp_clk_timing(50_000, sample_mode=ni.AcquisitionType.CONTINUOUS)
    task.read(10)
    cdaq.device.output_v["cDAQ1Mod2/ao0"] = 1.0  # acts from edge 10, felt at 11, read 40.01 + 0.225 samples later
    force = np.array(task.read(100))
    np.testing.assert_allclose(force[[40, 42]], [0.05, 12.05], atol=1e-4)
    assert cdaq.device.bench.clock.now_s == pytest.approx(110 / 50_000)


def test_an_output_can_run_on_its_own_clock_and_hold_its_last_value(cdaq) -> None:
    task = cdaq.task()
    task.ao_channels.add_ao_voltage_chan("cDAQ1Mod2/ao0")
    task.timing.cfg_samp_clk_timing(1000, samps_per_chan=100)
    task.write(np.linspace(0, 3, 100), auto_start=True)
    task.wait_until_done(timeout=0.2)
    assert cdaq.device.output_v["cDAQ1Mod2/ao0"] == 3.0
    assert cdaq.device.bench.plant.truth().size == 100


def test_a_clock_that_nothing_drives_never_ticks(cdaq, bridge) -> None:
    task = cdaq.task()
    bridge(task)
    task.timing.cfg_samp_clk_timing(5000, source="/cDAQ1Mod3/PFI0", sample_mode=ni.AcquisitionType.CONTINUOUS)
    with pytest.raises(DaqReadError) as never:
        task.read(1, timeout=0.5)
    assert never.value.error_code == -200284


def test_an_input_without_a_clock_reads_what_is_there_now(cdaq, bridge, encoder) -> None:
    cdaq.device.lines["cDAQ1Mod4/port0/line7"] = True
    cell, counts = cdaq.task(), cdaq.task()
    bridge(cell)
    encoder(counts)
    assert cell.read() == pytest.approx(0.05, abs=1e-4)
    assert counts.read() == 0.0
    cdaq.device.output_v["cDAQ1Mod2/ao0"] = 1.0
    # the first look starts the bench; then a reading takes a millisecond while no clock runs
    assert cdaq.device.bench.clock.now_s == pytest.approx(1 / 5000 + 2e-3)


def test_unread_samples_beyond_the_buffer_are_lost_and_said_so(cdaq, refused, force_task) -> None:
    force = force_task(cdaq)
    force.start()
    force.read(10)
    cdaq.advance(10_000)  # the driver keeps 10 kS at this rate
    assert force.in_stream.avail_samp_per_chan == 10_000
    cdaq.advance(1)
    with refused(-200279):
        force.read(10)


def test_encoder_units_and_decoding_follow_the_task(cdaq, encoder, force_task) -> None:
    cdaq.device.lines["cDAQ1Mod4/port0/line7"] = True
    cdaq.device.output_v["cDAQ1Mod2/ao0"] = -1.0  # held from the start: hammer at -0.3 rad from sample 1
    force, found = force_task(cdaq), {}
    settings = {
        "ticks": ({}, -163840 / (2 * np.pi) * -0.3),
        "x2": ({"decoding_type": ni.EncoderType.X_2}, -81920 / (2 * np.pi) * -0.3),
        "radians": ({"units": ni.AngleUnits.RADIANS, "pulses_per_rev": 40960, "initial_angle": 2.0}, 2.3),
        "degrees": ({"units": ni.AngleUnits.DEGREES, "pulses_per_rev": 40960}, np.degrees(0.3)),
    }
    tasks = {}
    for index, (name, (changes, _)) in enumerate(settings.items()):
        tasks[name] = cdaq.task()
        encoder(tasks[name], f"cDAQ1Mod3/ctr{index}", **changes)
        tasks[name].timing.cfg_samp_clk_timing(
            5000, source="/cDAQ1/ai/SampleClock", sample_mode=ni.AcquisitionType.CONTINUOUS
        )
        tasks[name].start()
    force.start()
    force.read(20)
    for name, (_, expected) in settings.items():
        found[name] = tasks[name].read(20)
        assert found[name][10] == pytest.approx(expected, rel=2e-4), name


def test_units_of_force_follow_the_task(cdaq, bridge) -> None:
    cdaq.device.lines["cDAQ1Mod4/port0/line7"] = True
    cdaq.device.output_v["cDAQ1Mod2/ao0"] = 2.0
    task = cdaq.task()
    bridge(task, min_val=-4.0, max_val=25.0, units=ni.ForceUnits.POUNDS)
    task.timing.cfg_samp_clk_timing(5000, sample_mode=ni.AcquisitionType.CONTINUOUS)
    assert task.read(60)[59] == pytest.approx(24.05 / 4.4482216, rel=1e-5)


def test_scalar_and_register_reads_give_the_next_sample_as_the_register_holds_it(cdaq, force_task, encoder) -> None:
    cdaq.device.lines["cDAQ1Mod4/port0/line7"] = True
    cdaq.device.output_v["cDAQ1Mod2/ao0"] = 1.0  # hammer: +0.3 rad, counts down
    force, counts = force_task(cdaq), cdaq.task()
    encoder(counts)
    counts.timing.cfg_samp_clk_timing(5000, source="/cDAQ1/ai/SampleClock", sample_mode=ni.AcquisitionType.CONTINUOUS)
    counts.start()
    force.start()
    cell = nidaqmx.stream_readers.AnalogSingleChannelReader(force.in_stream)
    counter = nidaqmx.stream_readers.CounterReader(counts.in_stream)
    assert cell.read_one_sample() == pytest.approx(0.05, abs=1e-4)
    assert force.in_stream.curr_read_pos == 1
    assert counter.read_one_sample_double() == 0.0
    below = -int(163840 / (2 * np.pi) * 0.3)
    assert counter.read_one_sample_uint32() == pytest.approx(2**32 + below, abs=1)
    register = np.zeros(3, dtype=np.uint32)
    counter.read_many_sample_uint32(register, 3)
    assert register == pytest.approx(2**32 + below, abs=1)


def test_a_range_of_channels_is_read_channel_by_channel_or_scan_by_scan(bench_of) -> None:
    card = bench_of("pcie6363")
    task = card.task()
    task.ai_channels.add_ai_voltage_chan("Dev1/ai2:0", name_to_assign_to_channel="in")
    task.timing.cfg_samp_clk_timing(10_000, sample_mode=ni.AcquisitionType.CONTINUOUS)
    assert [c.physical_channel.name for c in task.ai_channels] == ["Dev1/ai2", "Dev1/ai1", "Dev1/ai0"]
    rows = np.array(task.read(4))
    assert rows.shape == (3, 4) and not rows[:2].any()
    np.testing.assert_allclose(rows[2], 0.05 * 10 / 111.2, atol=20 / 2**16)
