"""What programs written for an NI card do with it, on the virtual card: the call sequences of NI's usual examples.

What programs written for an NI card do with its lines, and with the card itself, on the virtual card.
"""

from __future__ import annotations

import threading

import nidaqmx
import numpy as np
import pytest
from nidaqmx import constants as ni
from nidaqmx.errors import DaqReadError
from nidaqmx.stream_writers import AnalogSingleChannelWriter

FINITE, CONTINUOUS = ni.AcquisitionType.FINITE, ni.AcquisitionType.CONTINUOUS


def test_callbacks_of_the_real_client_see_every_sample(cdaq, bridge) -> None:
    task = cdaq.task()
    bridge(task)
    task.timing.cfg_samp_clk_timing(5000, sample_mode=CONTINUOUS, samps_per_chan=1000)
    enough, seen = threading.Event(), []

    def callback(handle, kind, n, data) -> int:
        seen.append(len(task.read(number_of_samples_per_channel=n)))
        if len(seen) >= 5:
            enough.set()
        return 0

    task.register_every_n_samples_acquired_into_buffer_event(500, callback)
    task.start()
    assert enough.wait(20)
    task.stop()
    task.register_every_n_samples_acquired_into_buffer_event(500, None)
    assert seen[:5] == [500] * 5


def test_a_continuous_output_repeats_its_buffer_and_one_without_regeneration_runs_dry(card) -> None:
    task = card.task()
    task.ao_channels.add_ao_voltage_chan("Dev1/ao1")
    task.timing.cfg_samp_clk_timing(1000.0, sample_mode=CONTINUOUS)
    task.write([float(i) for i in range(10)])
    task.start()
    card.advance(23)
    assert card.device.output_v["Dev1/ao1"] == 2.0 and not task.is_task_done()
    task.stop()
    task.out_stream.regen_mode = ni.RegenerationMode.DONT_ALLOW_REGENERATION
    writer = AnalogSingleChannelWriter(task.out_stream, auto_start=False)
    writer.write_many_sample(np.linspace(0, 1, 100))
    task.start()
    card.advance(50)
    writer.write_many_sample(np.linspace(1, 2, 100))
    assert card.device.bench.edge == pytest.approx(100, abs=11)  # the write waited for room in the buffer of 100
    card.advance(99)
    assert not task.is_task_done() and 1.9 < card.device.output_v["Dev1/ao1"] < 2.0
    card.advance(100)
    with pytest.raises(nidaqmx.errors.DaqError, match="-200290"):
        task.is_task_done()
    assert card.device.output_v["Dev1/ao1"] == 2.0  # the DAC holds its last value


def test_input_and_output_with_clocks_of_their_own_start_on_one_trigger(card) -> None:
    inputs, outputs = card.inputs("Dev1/ai1", 1000, 10_000.0), card.task()  # wired to ao0
    outputs.ao_channels.add_ao_voltage_chan("Dev1/ao0")
    outputs.timing.cfg_samp_clk_timing(1000.0, sample_mode=FINITE, samps_per_chan=50)
    outputs.triggers.start_trigger.cfg_dig_edge_start_trig("/Dev1/ai/StartTrigger")
    assert outputs.triggers.start_trigger.dig_edge_src == "/Dev1/ai/StartTrigger"
    outputs.write([float(i) / 10 for i in range(50)], auto_start=True)
    assert card.device.output_v.get("Dev1/ao0", 0.0) == 0.0
    inputs.start()
    read = np.array(inputs.read(1000))
    # value k is put out at ms k and read from the next sample on, ten times; it stays at the last
    k = np.minimum(np.maximum(np.arange(1000) - 1, 0) // 10, 49)
    np.testing.assert_allclose(read, k / 10, atol=20 / 2**16)
    outputs.wait_until_done(timeout=1.0)


def test_two_clocks_without_a_trigger_run_side_by_side(card) -> None:
    first, second = card.task(), card.inputs("Dev1/ai2", 50, 250.0)
    first.ao_channels.add_ao_voltage_chan("Dev1/ao1")
    first.timing.cfg_samp_clk_timing(1000.0, sample_mode=CONTINUOUS)
    first.write([1.0, 2.0], auto_start=True)
    assert second.read(50) == [0.0] * 50
    assert card.device.bench.edge == pytest.approx(197, abs=1)  # 49 intervals of 4 ms, and one edge
    first.stop()
    assert second.is_task_done()


def test_a_single_pulse_ends_and_a_train_is_counted_and_its_frequency_measured(card) -> None:
    pulse = card.task()
    pulse.co_channels.add_co_pulse_chan_time("Dev1/ctr0", initial_delay=1.0, low_time=0.5, high_time=1.0)
    pulse.start()
    with pytest.raises(nidaqmx.errors.DaqError, match="-200560"):
        pulse.wait_until_done(timeout=1.5)
    pulse.wait_until_done(timeout=10.0)
    assert card.device.bench.edge / card.device.bench.rate_hz == pytest.approx(2.0, abs=1e-3)
    pulse.stop()
    train, count, frequency = card.pulses(100.0, initial_delay=0.005), card.task(), card.task()
    channel = count.ci_channels.add_ci_count_edges_chan("Dev1/ctr1", initial_count=7)
    channel.ci_count_edges_term = "/Dev1/PFI12"
    train.start()
    count.start()
    card.advance(5000)
    assert count.read() == 7 + 100  # 1 s
    channel = frequency.ci_channels.add_ci_freq_chan("Dev1/ctr2", min_val=1.0, max_val=1e4)
    channel.ci_freq_term = "/Dev1/Ctr0InternalOutput"
    assert frequency.read() == pytest.approx(100.0)
    train.stop()
    with pytest.raises(DaqReadError, match="-200284"):
        frequency.read(timeout=0.1)


def test_a_finite_train_has_the_pulses_it_was_asked_for(card) -> None:
    train, count = card.pulses(1000.0, "Dev1/ctr3", 25), card.task()
    channel = count.ci_channels.add_ci_count_edges_chan("Dev1/ctr1")
    channel.ci_count_edges_term = "/Dev1/PFI15"
    count.start()
    train.start()
    train.wait_until_done(timeout=1.0)
    assert count.read() == 25


def test_an_encoder_is_read_on_the_clock_of_the_analog_input(card) -> None:
    inputs, angle = card.inputs("Dev1/ai2"), card.task()
    angle.ci_channels.add_ci_ang_encoder_chan(
        "Dev1/ctr0", decoding_type=ni.EncoderType.X_4, units=ni.AngleUnits.RADIANS, pulses_per_rev=81920
    )
    angle.timing.cfg_samp_clk_timing(1000.0, source="/Dev1/ai/SampleClock", sample_mode=CONTINUOUS)
    angle.start()
    inputs.start()
    assert len(inputs.read(100)) == len(angle.read(100)) == 100
    # edges on A alone, counted: one per four counts
    card.device.bench._count_a_edges(np.array([[0, 0, 0, 9], [41, -41, 3, 0], [80, -80, 4, 9], [70, -70, 4, 0]]))
    assert [card.device.bench._a_passed[-1, body] for body in range(3)] == [20 + 2, 20 + 2, 1]


def test_a_trigger_that_never_comes_times_out(card) -> None:
    for trigger in ("start", "reference"):
        task = card.inputs("Dev1/ai2", 100)
        if trigger == "start":
            task.triggers.start_trigger.cfg_dig_edge_start_trig("/Dev1/PFI0")
        else:
            task.triggers.reference_trigger.cfg_dig_edge_ref_trig("/Dev1/PFI0", pretrigger_samples=50)
        task.start()
        with pytest.raises(DaqReadError, match="-200284"):
            task.read(100, timeout=0.5)
        task.close()
        card._tasks.remove(task)


def test_an_exported_clock_drives_another_task(card, refused) -> None:
    inputs, lines = card.inputs("Dev1/ai2", 40), card.task()
    inputs.export_signals.export_signal(ni.Signal.SAMPLE_CLOCK, "/Dev1/PFI4")
    lines.di_channels.add_di_chan("Dev1/port0/line0")
    lines.timing.cfg_samp_clk_timing(1000.0, source="/Dev1/PFI4", samps_per_chan=40)
    lines.start()
    assert len(inputs.read(40)) == len(lines.read(40)) == 40
    with refused(-89136):
        inputs.export_signals.export_signal(ni.Signal.SAMPLE_CLOCK, "/Dev1/ai/SampleClock")


def test_the_sum_of_the_rates_and_the_number_of_outputs_limit_the_rate(card, refused) -> None:
    several, outputs = card.inputs("Dev1/ai0:3", 1000, 250_000.0), card.task()
    with refused(-200332):
        several.timing.cfg_samp_clk_timing(250_001.0)
    outputs.ao_channels.add_ao_voltage_chan("Dev1/ao0:1")
    with refused(-200332):
        outputs.timing.cfg_samp_clk_timing(2_000_001.0)
    outputs.timing.cfg_samp_clk_timing(30_000.0)
    assert outputs.timing.samp_clk_rate == pytest.approx(100e6 / 3333, rel=1e-12)


def test_a_client_that_reads_what_is_there_gets_what_has_come(card) -> None:
    task = card.inputs("Dev1/ai2")
    task.start()
    got, reads = 0, 0
    while got < 100:
        got += len(task.read(ni.READ_ALL_AVAILABLE))
        reads += 1
    assert reads < 50 and card.device.bench.edge == got
    assert task.in_stream.avail_samp_per_chan == 10  # asking took 10 ms


def test_lines_and_ports_are_written_and_read_and_changes_are_detected(card) -> None:
    out, port, changes = card.task(), card.task(), card.task()
    out.do_channels.add_do_chan("Dev1/port0/line0:3", line_grouping=ni.LineGrouping.CHAN_PER_LINE)
    port.di_channels.add_di_chan("Dev1/port0", line_grouping=ni.LineGrouping.CHAN_FOR_ALL_LINES)
    changes.di_channels.add_di_chan("Dev1/port0/line0:1", line_grouping=ni.LineGrouping.CHAN_PER_LINE)
    changes.timing.cfg_change_detection_timing(
        rising_edge_chan="Dev1/port0/line0:1", falling_edge_chan="Dev1/port0/line0", sample_mode=CONTINUOUS
    )
    changes.start()
    assert out.write([True, False, True, True], auto_start=True) == 1
    assert port.read() == 0b1101
    out.write([True, False, False, True], auto_start=True)  # line 2 is not watched
    out.write([True, True, False, True], auto_start=True)
    out.write([True, False, False, True], auto_start=True)  # line 1 falls, and only its rise is watched
    assert changes.read(2, timeout=0.1) == [[True, True], [False, True]]
    with pytest.raises(DaqReadError, match="-200284"):
        changes.read(1, timeout=0.1)
    whole = card.task()
    with pytest.raises(nidaqmx.errors.DaqError, match="-50103"):
        whole.do_channels.add_do_chan("Dev1/port0", line_grouping=ni.LineGrouping.CHAN_FOR_ALL_LINES)
        out.control(ni.TaskMode.TASK_RESERVE)
        whole.write(0xFFFF, auto_start=True)
    out.control(ni.TaskMode.TASK_UNRESERVE)
    whole.write(0xFFFF, auto_start=True)
    assert port.read() == 0xFFFF


def test_lines_have_clocks_on_port_0_only(card, refused) -> None:
    out = card.task()
    out.do_channels.add_do_chan("Dev1/port0/line0:7", line_grouping=ni.LineGrouping.CHAN_FOR_ALL_LINES)
    out.timing.cfg_samp_clk_timing(1000.0, sample_mode=FINITE, samps_per_chan=3)
    out.write([1, 2, 4], auto_start=True)
    out.wait_until_done(timeout=1.0)
    back = card.task()
    back.di_channels.add_di_chan("Dev1/port0/line0:7", line_grouping=ni.LineGrouping.CHAN_FOR_ALL_LINES)
    back.timing.cfg_samp_clk_timing(1000.0, samps_per_chan=5)
    assert back.read(5) == [4] * 5
    static = card.task()
    static.do_channels.add_do_chan("Dev1/port1/line0")
    with refused(-200452):
        static.timing.cfg_samp_clk_timing(1000.0)


def test_a_reset_clears_what_a_dead_client_left(card) -> None:
    from nidaqmx.system import Device

    task = card.task("left")
    task.ao_channels.add_ao_voltage_chan("Dev1/ao0")
    task.write(3.0, auto_start=True)
    device = Device("Dev1", grpc_options=nidaqmx.GrpcSessionOptions(card._channel, ""))
    assert [c.name for c in device.ao_physical_chans] == [f"Dev1/ao{i}" for i in range(4)]
    assert device.di_ports.channel_names == ["Dev1/port0", "Dev1/port1", "Dev1/port2"]
    assert len(device.ai_physical_chans) == 32 and len(device.ci_physical_chans) == 4
    device.self_test_device()
    device.reset_device()
    assert card.device.output_v["Dev1/ao0"] == 0.0 and card.device.tasks == {}
    card._tasks.remove(task)
    task._handle = None
