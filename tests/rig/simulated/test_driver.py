"""What the virtual device hands over: order, timeouts, overwriting, units; seen through the real client.

The virtual device refuses what the product refuses, with the driver's status, seen through the real client.
"""

from __future__ import annotations

from typing import Any

import grpc
import nidaqmx
import numpy as np
import pytest
from nidaqmx import constants as ni
from nidaqmx.errors import DaqReadError, RpcError

from rig.simulated.driver import clear_task


@pytest.fixture
def force_task(bridge) -> Any:
    """Make a force task."""

    def make(cdaq: Any, samples: int = 1000, mode: Any = ni.AcquisitionType.CONTINUOUS) -> nidaqmx.Task:
        task = cdaq.task()
        bridge(task)
        task.timing.cfg_samp_clk_timing(5000, sample_mode=mode, samps_per_chan=samples)
        return task

    return make


def test_a_slave_started_after_the_master_has_missed_its_trigger(cdaq, encoder, force_task, refused) -> None:
    force, counts = force_task(cdaq), cdaq.task()
    encoder(counts)
    counts.timing.cfg_samp_clk_timing(5000, source="/cDAQ1/ai/SampleClock", sample_mode=ni.AcquisitionType.CONTINUOUS)
    counts.triggers.arm_start_trigger.trig_type = ni.TriggerType.DIGITAL_EDGE
    counts.triggers.arm_start_trigger.dig_edge_src = "/cDAQ1/ai/StartTrigger"
    force.start()
    counts.start()
    force.read(100)
    with refused(-200284):
        counts.read(100, timeout=0.5)


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


def test_a_finite_acquisition_ends_and_is_read_to_its_end(cdaq, force_task, refused) -> None:
    force = force_task(cdaq, 250, ni.AcquisitionType.FINITE)
    force.start()
    assert not force.is_task_done()
    assert len(force.read(ni_all := nidaqmx.constants.READ_ALL_AVAILABLE)) == 250 and ni_all == -1
    assert force.is_task_done()
    with refused(-200278):
        force.read(1, timeout=0.1)


def test_asking_whether_a_task_is_done_lets_time_pass(cdaq, force_task) -> None:
    force = force_task(cdaq, 250, ni.AcquisitionType.FINITE)
    force.start()
    polls = next(k for k in range(1000) if force.is_task_done())
    assert polls == 50  # 1 ms each but the first


def test_waiting_for_the_end_of_a_task_takes_its_time_and_is_refused_after_the_timeout(cdaq, force_task) -> None:
    force = force_task(cdaq, 250, ni.AcquisitionType.FINITE)
    for _ in range(2):
        force.start()
        force.wait_until_done(timeout=0.05)  # 250 samples at 5 kHz
        force.stop()
    force.start()
    with pytest.raises(nidaqmx.DaqError, match="-200560"):
        force.wait_until_done(timeout=0.049)


def test_a_clock_that_nothing_drives_never_ticks(cdaq, bridge, refused) -> None:
    task = cdaq.task()
    bridge(task)
    task.timing.cfg_samp_clk_timing(5000, source="/cDAQ1Mod3/PFI0", sample_mode=ni.AcquisitionType.CONTINUOUS)
    with refused(-200284):
        task.read(1, timeout=0.5)


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


def test_channels_that_do_not_exist_or_cannot_measure_this(cdaq, card, bridge, refused) -> None:
    with refused(-200170):
        bridge(cdaq.task(), "cDAQ1Mod1/ai4")
    with refused(-200220):
        bridge(cdaq.task(), "Dev7/ai0")
    with refused(-200431):
        bridge(cdaq.task(), "cDAQ1Mod2/ao0")
    with refused(-200431):
        bridge(card.task(), "Dev1/ai0")  # an X Series card has no bridge input
    with refused(-200431):
        cdaq.task().ai_channels.add_ai_voltage_chan("cDAQ1Mod1/ai0")
    with refused(-200432):
        cdaq.task().ao_channels.add_ao_voltage_chan("cDAQ1Mod1/ai0")


@pytest.mark.parametrize(
    "changes",
    [
        {"voltage_excit_val": 4.0},
        {"max_val": 1500.0},  # 27 mV/V
        {"second_physical_val": 0.0},
        {"units": ni.ForceUnits.FROM_CUSTOM_SCALE},
    ],
)
def test_bridge_settings_the_9237_does_not_have(changes, cdaq, bridge, refused) -> None:
    with refused(-200077):
        bridge(cdaq.task(), **changes)


def test_one_converter_serves_one_task_at_a_time(card, refused) -> None:
    clocked, on_demand = card.inputs("Dev1/ai2"), card.task()
    on_demand.ai_channels.add_ai_voltage_chan("Dev1/ai3")
    assert on_demand.read() == 0.0
    clocked.start()
    with refused(-50103):
        on_demand.read()


def test_a_terminal_carries_one_signal(card, refused) -> None:
    inputs, outputs, pulses = card.task(), card.task(), card.task()
    inputs.ai_channels.add_ai_voltage_chan("Dev1/ai2")
    outputs.ao_channels.add_ao_voltage_chan("Dev1/ao1")
    inputs.export_signals.export_signal(ni.Signal.SAMPLE_CLOCK, "/Dev1/PFI4")
    with refused(-89137):
        outputs.export_signals.export_signal(ni.Signal.SAMPLE_CLOCK, "/Dev1/PFI4")
    pulses.co_channels.add_co_pulse_chan_freq("Dev1/ctr0").co_pulse_term = "/Dev1/PFI5"
    pulses.control(ni.TaskMode.TASK_COMMIT)
    with refused(-89137):
        outputs.export_signals.export_signal(ni.Signal.SAMPLE_CLOCK, "/Dev1/PFI5")


@pytest.mark.parametrize(
    ("asked", "got"), [(5000, 5000), (4999, 5000), (4000, 50e3 / 12), (50e3, 50e3), (30e3, 50e3), (100, 50e3 / 31)]
)
def test_the_9237_runs_at_50_khz_over_n_coerced_up(asked, got, cdaq, bridge) -> None:
    task = cdaq.task()
    bridge(task)
    task.timing.cfg_samp_clk_timing(asked, sample_mode=ni.AcquisitionType.CONTINUOUS)
    assert task.timing.samp_clk_rate == pytest.approx(got, rel=1e-12)


def test_rates_above_the_product_are_refused(cdaq, card, bridge, refused) -> None:
    task = cdaq.task()
    bridge(task)
    with refused(-200332):
        task.timing.cfg_samp_clk_timing(50_001)
    voltage = card.task()
    voltage.ai_channels.add_ai_voltage_chan("Dev1/ai0")
    with refused(-200332):
        voltage.timing.cfg_samp_clk_timing(2_000_001)
    for slow in (0, 0.02):  # 100 MHz over 2**32 is the slowest clock
        with refused(-200077):
            voltage.timing.cfg_samp_clk_timing(slow)


def test_one_counter_per_task_and_no_mixture_of_types(cdaq, bridge, encoder, refused) -> None:
    task = cdaq.task()
    encoder(task)
    with refused(-200147):
        task.ci_channels.add_ci_ang_encoder_chan("cDAQ1Mod3/ctr1", pulses_per_rev=81920)
    with refused(-200559):
        bridge(task)


def test_a_counter_needs_a_clock_and_terminals_that_exist(cdaq, encoder, refused) -> None:
    task = cdaq.task()
    channel = encoder(task)
    with refused(-200303):
        task.timing.cfg_samp_clk_timing(5000)
    for terminal in ("/cDAQ1/ai/SampelClock", "cDAQ1/ai/SampelClock", "/Dev1/ai/SampleClock", "/cDAQ1/Mod3/PFI0"):
        with refused(-89120):
            task.timing.cfg_samp_clk_timing(5000, source=terminal)
    for terminal in ("cDAQ1/ai/SampleClock", "ai/SampleClock", "/cdaq1/AI/sampleclock"):  # with and without its slash
        task.timing.cfg_samp_clk_timing(5000, source=terminal)
    for terminal in ("cDAQ1Mod3/PFI0", "/cDAQ1Mod3/PFI0", "/cdaq1mod3/pfi0"):
        channel.ci_encoder_a_input_term = terminal
    with refused(-89120):
        channel.ci_encoder_a_input_term = "/cDAQ1Mod3/PFI6"
    with refused(-89120):
        task.triggers.arm_start_trigger.dig_edge_src = "/cDAQ1/ai/StartTriger"


def test_counters_have_the_terminals_of_the_card_and_on_the_chassis_must_be_told(cdaq, card, refused) -> None:
    channel = card.task().ci_channels.add_ci_ang_encoder_chan("Dev1/ctr1", pulses_per_rev=81920)
    assert (channel.ci_encoder_a_input_term, channel.ci_encoder_b_input_term) == ("/Dev1/PFI3", "/Dev1/PFI11")
    task = cdaq.task()
    task.ci_channels.add_ci_ang_encoder_chan("cDAQ1Mod3/ctr0", pulses_per_rev=81920)
    with refused(-89120):
        task.start()


def test_an_arm_trigger_needs_a_source(cdaq, encoder, refused) -> None:
    task = cdaq.task()
    encoder(task)
    task.triggers.arm_start_trigger.trig_type = ni.TriggerType.DIGITAL_EDGE
    with refused(-89120):
        task.start()


def test_frame_pulses_cannot_leave_through_an_input_module(cdaq, refused) -> None:
    channel = cdaq.task().co_channels.add_co_pulse_chan_freq("cDAQ1Mod4/ctr3", freq=2000.0)
    with refused(-89136):
        channel.co_pulse_term = "/cDAQ1Mod3/PFI0"


def test_what_another_task_holds_is_reserved_until_it_lets_go(cdaq, encoder, refused) -> None:
    first, second = cdaq.task(), cdaq.task()
    encoder(first)
    encoder(second, "cDAQ1Mod4/ctr0")  # the chassis has four counters, whatever module they are named by
    first.control(ni.TaskMode.TASK_COMMIT)
    with refused(-50103):
        second.control(ni.TaskMode.TASK_COMMIT)
    first.control(ni.TaskMode.TASK_UNRESERVE)
    second.control(ni.TaskMode.TASK_COMMIT)
    with refused(-50103):
        first.start()


def test_a_line_that_carries_frame_pulses_cannot_be_written(cdaq, refused) -> None:
    pulses, lines = cdaq.task(), cdaq.task()
    pulses.co_channels.add_co_pulse_chan_freq("cDAQ1Mod4/ctr3", freq=2000.0).co_pulse_term = "/cDAQ1Mod4/PFI4"
    pulses.control(ni.TaskMode.TASK_COMMIT)
    lines.do_channels.add_do_chan("cDAQ1Mod4/port0/line4")
    with refused(-50103):
        lines.write(True)


def motor(task: nidaqmx.Task, samples: int = 10) -> None:
    task.ao_channels.add_ao_voltage_chan("cDAQ1Mod2/ao0", min_val=-5.0, max_val=5.0)
    task.timing.cfg_samp_clk_timing(5000, source="/cDAQ1/ai/SampleClock", samps_per_chan=samples)


def test_outputs_refuse_values_ranges_and_starting_empty(cdaq, refused) -> None:
    task = cdaq.task()
    with refused(-200077):
        task.ao_channels.add_ao_voltage_chan("cDAQ1Mod2/ao0", min_val=-10.1, max_val=10.0)
    motor(task)
    with refused(-200462):
        task.start()
    for bad in (5.1, -5.1, np.nan):
        with refused(-200561):
            task.write([0.0, bad, 0.0], auto_start=False)


def test_a_generation_in_progress_holds_its_channel_against_an_on_demand_write(cdaq, refused) -> None:
    running, zero = cdaq.task(), cdaq.task()
    motor(running)
    running.write(np.ones(10), auto_start=True)
    zero.ao_channels.add_ao_voltage_chan("cDAQ1Mod2/ao0")
    with refused(-50103):
        zero.write(0.0, auto_start=True)
    running.stop()
    zero.write(0.0, auto_start=True)
    with refused(-200846):
        zero.write(0.0, auto_start=False)


def test_a_second_client_attaches_and_a_cleared_task_is_gone(cdaq, refused) -> None:
    task = cdaq.task("a")
    behaviors = nidaqmx.SessionInitializationBehavior

    def session(name: str, behavior: nidaqmx.SessionInitializationBehavior) -> nidaqmx.Task:
        options = cdaq.options(name, initialization_behavior=behavior)
        return nidaqmx.Task(name, grpc_options=options)

    for behavior in (behaviors.AUTO, behaviors.ATTACH_TO_SERVER_SESSION):
        with session("a", behavior) as shared:
            assert shared.name == "a"
        assert "a" in cdaq.device.tasks  # who attached only detaches
    for name, behavior, code in (
        ("a", behaviors.INITIALIZE_SERVER_SESSION, grpc.StatusCode.ALREADY_EXISTS),
        ("b", behaviors.ATTACH_TO_SERVER_SESSION, grpc.StatusCode.FAILED_PRECONDITION),
    ):
        with pytest.raises(RpcError) as refusal:
            session(name, behavior)
        assert refusal.value.rpc_code == code
    assert cdaq.task().name != cdaq.task().name
    with refused(-200478):
        task.start()
    clear_task(cdaq.device, "a")
    with refused(-200088):
        task.start()
    cdaq.forget(task)
