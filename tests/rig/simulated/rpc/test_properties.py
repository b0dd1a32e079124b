"""Properties of devices, channels and tasks, waveforms and converter codes, through the real client.

Settings the virtual device cannot act on: kept and answered as the driver does, and their tasks refused, by name.

Values and refusals as the hardware gives them, to clients that are not ours.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any

import nidaqmx
import numpy as np
import pytest
from nidaqmx import constants as ni
from nidaqmx.constants import AcquisitionType, LineGrouping, Signal, TriggerType
from nidaqmx.error_codes import DAQmxErrors
from nidaqmx.errors import DaqError
from nidaqmx.grpc_session_options import GrpcSessionOptions
from nidaqmx.system import Device, PhysicalChannel, System
from nidaqmx.system.storage import PersistedChannel, PersistedScale, PersistedTask
from nidaqmx.system.watchdog import DOExpirationState, WatchdogTask


def system(bench) -> System:
    return System.remote(GrpcSessionOptions(bench._channel, ""))


def test_a_chassis_and_its_modules_say_what_they_are(cdaq) -> None:
    devices = {device.name: device for device in system(cdaq).devices}
    assert [(name, d.product_type) for name, d in devices.items()][:3] == [
        ("cDAQ1", "cDAQ-9189"), ("cDAQ1Mod1", "NI 9237"), ("cDAQ1Mod2", "NI 9263"),
    ]  # fmt: skip
    module = devices["cDAQ1Mod4"]
    assert module.product_category == ni.ProductCategory.C_SERIES_MODULE
    assert (module.compact_daq_chassis_device.name, module.compact_daq_slot_num) == ("cDAQ1", 4)
    assert [port.name for port in module.di_ports] == ["cDAQ1Mod4/port0"]
    assert [channel.name for channel in devices["cDAQ1Mod1"].ai_physical_chans] == [
        f"cDAQ1Mod1/ai{i}" for i in range(4)
    ]


def test_a_card_states_its_limits_and_refuses_what_is_not_in_its_table(card, refused) -> None:
    device = system(card).devices["Dev1"]
    assert device.product_category == ni.ProductCategory.X_SERIES_DAQ and device.is_simulated
    assert (device.ai_max_single_chan_rate, device.ai_max_multi_chan_rate) == (2e6, 1e6)
    assert device.ai_voltage_rngs[-2:] == [-10.0, 10.0] and device.ci_max_size == 32
    with refused(-200452):
        _ = device.ai_couplings
    with refused(-200452):
        _ = device.product_num


def test_limits_of_a_channel_can_be_changed_and_choose_its_range(card, refused) -> None:
    task = card.task()
    one = task.ai_channels.add_ai_voltage_chan("Dev1/ai0", min_val=-0.1, max_val=0.1)
    three = task.ai_channels.add_ai_voltage_chan("Dev1/ai1:3", min_val=-10.0, max_val=10.0)
    assert (one.ai_rng_high, three.ai_rng_high) == (0.1, 10.0)
    one.ai_max = 5.0
    assert (one.ai_min, one.ai_max, one.ai_rng_high, three.ai_max) == (-5.0, 5.0, 5.0, 10.0)  # coerced to the range
    two = task.ai_channels["Dev1/ai2"]
    two.ai_min, two.ai_max = -1.0, 0.7
    assert [task.ai_channels[f"Dev1/ai{i}"].ai_max for i in (1, 2, 3)] == [10.0, 1.0, 10.0]
    two.ai_rng_high = 4.0
    assert (two.ai_rng_high, two.ai_rng_low, two.ai_min) == (5.0, -5.0, -5.0)
    with refused(-200077):
        one.ai_max = 11.0


def test_a_waveform_carries_times_names_units_and_the_samples(card) -> None:
    ramp, inputs = card.task(), card.inputs("Dev1/ai1:2")  # the first is wired to ao0
    ramp.ao_channels.add_ao_voltage_chan("Dev1/ao0")
    ramp.timing.cfg_samp_clk_timing(1000.0, sample_mode=ni.AcquisitionType.CONTINUOUS)
    ramp.write(np.arange(100) * 0.01)
    ramp.start()
    inputs.start()
    first, second = (inputs.read_waveform(20) for _ in range(2))
    np.testing.assert_allclose(second[0].scaled_data, 0.01 * np.arange(19, 39), atol=20 / 2**16)
    assert not second[1].scaled_data.any()
    assert (second[0].channel_name, second[0].units) == ("Dev1/ai1", "Volts")
    interval = second[0].timing.sample_interval.total_seconds()
    between = (second[0].timing.start_time - first[0].timing.start_time).total_seconds()
    assert (interval, between) == pytest.approx((1e-3, 20e-3), abs=1e-6)


def test_converter_codes_are_interleaved_steps_of_the_range(card) -> None:
    outputs, inputs = card.task(), card.inputs("Dev1/ai1:2", 3)
    outputs.ao_channels.add_ao_voltage_chan("Dev1/ao0")
    outputs.write(1.0, auto_start=True)
    codes = inputs.in_stream.read(number_of_samples_per_channel=3)
    assert list(codes[2:]) == [round(2**15 / 5), 0] * 2  # the output stands from the second sample on


def test_lines_are_written_and_read_as_waveforms(card) -> None:
    from nitypes.waveform import DigitalWaveform

    outputs, inputs = card.task(), card.task()
    outputs.do_channels.add_do_chan("Dev1/port0/line4:6", line_grouping=ni.LineGrouping.CHAN_FOR_ALL_LINES)
    outputs.timing.cfg_samp_clk_timing(1000.0, samps_per_chan=8)
    inputs.di_channels.add_di_chan("Dev1/port0/line4:6", line_grouping=ni.LineGrouping.CHAN_FOR_ALL_LINES)
    inputs.timing.cfg_samp_clk_timing(1000.0, source="do/SampleClock", samps_per_chan=8)
    levels = np.array([[i & 1, i >> 1 & 1, i >> 2 & 1] for i in range(8)], dtype=np.uint8)
    outputs.write(DigitalWaveform.from_lines(levels))
    inputs.start()
    outputs.start()
    read = inputs.read_waveform(8)
    # a line is read just before the edge that moves it
    assert read.signal_count == 3 and (np.asarray(read.data)[1:] == levels[:-1]).all() and not read.data[0].any()


@pytest.fixture
def voltage(card: Any) -> nidaqmx.Task:
    """A clocked voltage input."""
    return card.inputs("Dev1/ai0", 100, name="voltage")


def refused_to_start(task: nidaqmx.Task, said: str) -> None:
    with pytest.raises(DaqError, match=rf"not simulated: .*{said}") as refused:
        task.start()
    assert refused.value.error_code == -200452


def edge_start(task: nidaqmx.Task) -> None:
    task.triggers.start_trigger.cfg_anlg_edge_start_trig("APFI0", ni.Slope.FALLING, 1.5)


def window_start(task: nidaqmx.Task) -> None:
    task.triggers.start_trigger.cfg_anlg_window_start_trig(3.0, 1.0, "APFI1", ni.WindowTriggerCondition1.LEAVING_WINDOW)


def edge_reference(task: nidaqmx.Task) -> None:
    task.triggers.reference_trigger.cfg_anlg_edge_ref_trig("Dev1/ai0", 10, ni.Slope.RISING, 0.5)


@pytest.mark.parametrize(
    ("configure", "kind", "source"),
    [
        (edge_start, ni.TriggerType.ANALOG_EDGE, "/Dev1/APFI0"),
        (window_start, ni.TriggerType.ANALOG_WINDOW, "/Dev1/APFI1"),
        (edge_reference, ni.TriggerType.ANALOG_EDGE, "Dev1/ai0"),
    ],
)
def test_an_analog_trigger_is_kept_and_can_be_taken_away(
    voltage: nidaqmx.Task, configure: Callable[[nidaqmx.Task], None], kind: Any, source: str
) -> None:
    configure(voltage)
    start, reference = voltage.triggers.start_trigger, voltage.triggers.reference_trigger
    trigger = reference if configure is edge_reference else start
    assert trigger.trig_type == kind
    assert (trigger.anlg_win_src if configure is window_start else trigger.anlg_edge_src) == source
    if configure is edge_reference:
        assert reference.pretrig_samples == 10 and reference.anlg_edge_lvl == 0.5
    voltage.control(ni.TaskMode.TASK_VERIFY)
    start.disable_start_trig()
    reference.disable_ref_trig()
    assert trigger.trig_type == ni.TriggerType.NONE
    voltage.start()


def test_a_trigger_on_what_is_no_input_is_refused_at_once(voltage: nidaqmx.Task, refused) -> None:
    with refused(-200170):
        voltage.triggers.start_trigger.cfg_anlg_edge_start_trig("Dev1/ai99")


def test_a_trigger_without_a_sample_clock_has_the_drivers_code(card: Any) -> None:
    task = card.task("on_demand")
    task.ai_channels.add_ai_voltage_chan("Dev1/ai0")
    task.triggers.start_trigger.trig_type = ni.TriggerType.ANALOG_EDGE
    with pytest.raises(DaqError) as refused:
        task.control(ni.TaskMode.TASK_VERIFY)
    assert refused.value.error_type == DAQmxErrors.TRIG_WHEN_ON_DEMAND_SAMP_TIMING


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda task: task.ai_channels.add_ai_rtd_chan("Dev1/ai0"), "resistance thermometer"),
        (lambda task: task.ai_channels.add_ai_voltage_chan_with_excit("Dev1/ai1"), "voltage with excitation"),
        (lambda task: task.ci_channels.add_ci_semi_period_chan("Dev1/ctr0"), "semi-period"),
        (lambda task: task.ci_channels.add_ci_two_edge_sep_chan("Dev1/ctr1"), "two-edge separation"),
        (
            lambda task: task.ci_channels.add_ci_ang_encoder_chan(
                "Dev1/ctr0", decoding_type=ni.EncoderType.TWO_PULSE_COUNTING
            ),
            "two pulses",
        ),
        (lambda task: task.co_channels.add_co_pulse_chan_freq("Dev1/ctr2", idle_state=ni.Level.HIGH), "idle state"),
    ],
)
def test_a_channel_the_bench_has_no_sensor_for_is_made_and_never_read(card: Any, make: Any, said: str) -> None:
    task = card.task("sensor")
    make(task)
    refused_to_start(task, said)


def test_the_divisor_of_the_timebase_sets_the_rate(voltage: nidaqmx.Task) -> None:
    timing = voltage.timing
    assert timing.samp_clk_timebase_div == 100_000 and timing.samp_clk_src == "/Dev1/ai/SampleClockTimebase"
    timing.samp_clk_timebase_div = 200_000
    assert timing.samp_clk_rate == 500.0
    del timing.samp_clk_timebase_div
    assert timing.samp_clk_rate == 1000.0
    timing.samp_timing_type = ni.SampleTimingType.ON_DEMAND
    timing.samp_quant_samp_per_chan = 7
    timing.samp_timing_type = ni.SampleTimingType.SAMPLE_CLOCK
    assert timing.samp_quant_samp_per_chan == 7


def test_raw_codes_are_the_volts_of_a_16_bit_converter(card: Any) -> None:
    task = card.task("raw")
    for k in range(2):
        task.ao_channels.add_ao_voltage_chan(f"Dev1/ao{k}")
    task.out_stream.auto_start = True
    assert task.out_stream.write(np.array([0x4000, -0x2000], dtype=np.int16)) == 1
    assert card.device.output_v == {"Dev1/ao0": 5.0, "Dev1/ao1": -2.5}


def test_settings_of_a_watchdog(card: Any) -> None:
    options = nidaqmx.GrpcSessionOptions(card._channel, "dog")
    with WatchdogTask("Dev1", "dog", timeout=0.5, grpc_options=options) as dog:
        line = "Dev1/port0/line3"
        dog.cfg_watchdog_do_expir_states([DOExpirationState(line, ni.Level.TRISTATE)])
        assert dog.expiration_states[line].do_state == ni.Level.TRISTATE
        dog.timeout = 2.0
        assert dog.timeout == 2.0
        with pytest.raises(DaqError):
            dog.timeout = 1e6
        dog.expir_trig_dig_edge_src = "PFI0"
        with pytest.raises(DaqError, match="expiration trigger"):
            dog.start()
        del dog.expir_trig_dig_edge_src
        del dog.timeout
        assert dog.timeout == 10.0
        dog.start()
        dog.stop()


def test_what_the_system_has_not_saved_is_refused_by_the_drivers_codes(card: Any, refused) -> None:
    options = nidaqmx.GrpcSessionOptions(card._channel, "")
    for stored, code in (
        (PersistedChannel("none", grpc_options=options), -200882),
        (PersistedScale("none", grpc_options=options), -200378),
        (PersistedTask("none", grpc_options=options), -200485),
        (PhysicalChannel("Dev1/ai1234", grpc_options=options), -200170),
    ):
        with refused(code):
            _ = stored.ai_term_cfgs if isinstance(stored, PhysicalChannel) else stored.author


def test_a_card_answers_for_its_calibration_and_its_channels(card: Any) -> None:
    options = nidaqmx.GrpcSessionOptions(card._channel, "")
    device = Device("Dev1", grpc_options=options)
    assert device.cal_dev_temp == 0.0 and device.ext_cal_recommended_interval == 24
    device.self_cal()
    ai = {name: PhysicalChannel(f"Dev1/{name}", grpc_options=options).ai_term_cfgs for name in ("ai0", "ai8")}
    both = [ni.TerminalConfiguration.RSE, ni.TerminalConfiguration.NRSE]
    assert ai["ai0"] == [*both, ni.TerminalConfiguration.DIFF] and ai["ai8"] == both


def test_an_exported_signal_on_no_terminal_is_refused(voltage: nidaqmx.Task, refused) -> None:
    assert voltage.export_signals.samp_clk_output_behavior == ni.ExportAction.PULSE
    voltage.export_signals.start_trig_output_term = "RTSI"
    with refused(-89121):
        voltage.control(ni.TaskMode.TASK_VERIFY)
    voltage.export_signals.start_trig_output_term = "PFI4"
    refused_to_start(voltage, "START_TRIG_OUTPUT_TERM")


def test_what_is_not_simulated_is_refused_with_the_drivers_code(card, refused) -> None:
    with refused(-200431):
        card.task().ai_channels.add_ai_thrmstr_chan_iex("Dev1/ai0")
    with refused(-200220):
        card.task().ai_channels.add_ai_thrmstr_chan_iex("TS1Mod1/ai0")
    task = card.inputs("Dev1/ai0", 1000)
    task.triggers.start_trigger.trig_type = TriggerType.DIGITAL_PATTERN
    with refused(-200452):  # taken like a setting, never ignored
        task.start()
    task.triggers.start_trigger.disable_start_trig()
    task.in_stream.offset = 3
    with refused(-200452):
        task.start()
    task.in_stream.offset = 0
    task.in_stream.sleep_time = 0.01  # changes nothing a client can see
    task.start()


def test_more_than_a_finite_acquisition_has_is_cut_to_what_exists(card) -> None:
    task = card.inputs("Dev1/ai0:1", 50)
    task.start()
    assert [len(channel) for channel in task.read(30)] == [30, 30]
    assert [len(channel) for channel in task.read(100)] == [20, 20]
    with pytest.raises(DaqError, match="-200278"):
        task.read(1)


def test_events_may_be_registered_before_the_timing(card) -> None:
    task, seen = card.task(), []
    task.ai_channels.add_ai_voltage_chan("Dev1/ai0")
    task.register_every_n_samples_acquired_into_buffer_event(100, lambda *told: seen.append(told[2]) or 0)
    task.timing.cfg_samp_clk_timing(1000.0, samps_per_chan=300)
    task.start()
    assert len(task.read(300)) == 300
    end = time.monotonic() + 20
    while len(seen) < 3:
        assert time.monotonic() < end
        time.sleep(0.005)
    assert seen == [100, 100, 100]


def test_a_task_on_demand_is_done(card) -> None:
    task = card.task()
    task.ai_channels.add_ai_voltage_chan("Dev1/ai0")
    task.start()
    task.wait_until_done(timeout=0.1)
    assert task.is_task_done()


def test_one_value_cannot_be_written_to_several_channels(card, refused) -> None:
    from rig.simulated.rpc.messages import request_class

    volts, words = card.task("volts"), card.task("words")
    volts.ao_channels.add_ao_voltage_chan("Dev1/ao0:1")
    words.do_channels.add_do_chan("Dev1/port0/line0:1", line_grouping=LineGrouping.CHAN_PER_LINE)
    for call, task in (("WriteAnalogScalarF64", "volts"), ("WriteDigitalScalarU32", "words")):
        request = request_class(call)(value=1, auto_start=True)
        request.task.name = task
        with pytest.raises(Exception, match="-200524|one value for 2 channels"):
            card.service.handle(call, request)


@pytest.mark.parametrize("value", [float("inf"), float("-inf"), float("nan")])
def test_a_setting_that_is_not_finite_is_refused(value, card, refused) -> None:
    for add in (
        lambda task: task.ai_channels.add_ai_voltage_chan("Dev1/ai0", max_val=value),
        lambda task: task.ci_channels.add_ci_ang_encoder_chan("Dev1/ctr0", initial_angle=value),
        lambda task: task.co_channels.add_co_pulse_chan_freq("Dev1/ctr0", freq=value),
    ):
        with refused(-200077):
            add(card.task())
    task = card.task()
    task.ai_channels.add_ai_voltage_chan("Dev1/ai0")
    with refused(-200077):
        task.timing.cfg_samp_clk_timing(value, sample_mode=AcquisitionType.CONTINUOUS)


def test_rate_mode_and_length_of_a_clock_can_be_changed_and_are_coerced(card) -> None:
    task = card.inputs("Dev1/ai0", 1000)
    task.timing.samp_clk_rate = 3e4
    assert task.timing.samp_clk_rate == pytest.approx(100e6 / 3333, rel=1e-12)
    task.timing.samp_quant_samp_mode = AcquisitionType.CONTINUOUS
    assert task.timing.samp_quant_samp_mode == AcquisitionType.CONTINUOUS


@pytest.mark.parametrize("signal", [Signal.SAMPLE_CLOCK, Signal.SAMPLE_COMPLETE])
def test_a_signal_event_registered_before_its_clock_comes_with_every_sample(card, refused, signal) -> None:
    task, seen, ended = card.task(), [], threading.Event()
    task.ai_channels.add_ai_voltage_chan("Dev1/ai0")

    def count(_: object, kind: int, data: object) -> int:
        seen.append(kind)
        if len(seen) == 20:
            ended.set()
        return 0

    task.register_signal_event(signal, count)
    with refused(-200949):
        task.register_signal_event(signal, count)
    task.timing.cfg_samp_clk_timing(1000.0, samps_per_chan=20)
    task.start()
    task.read(20)
    assert ended.wait(20) and seen == [signal.value] * 20


def test_a_line_in_tristate_is_not_driven_and_is_pulled_low(card) -> None:
    out, back = card.task(), card.task()
    out.do_channels.add_do_chan("Dev1/port0/line0")
    out.do_channels.add_do_chan("Dev1/port0/line1")
    back.di_channels.add_di_chan("Dev1/port0/line0:1", line_grouping=LineGrouping.CHAN_PER_LINE)
    out.do_channels["Dev1/port0/line0"].do_tristate = True
    assert out.do_channels["Dev1/port0/line0"].do_tristate
    out.write([True, True], auto_start=True)
    assert not card.device.lines["Dev1/port0/line0"] and card.device.lines["Dev1/port0/line1"]
    assert not card.device.drive_enabled()  # which is on line 0
    out.stop()
    out.do_channels["Dev1/port0/line0"].do_tristate = False
    out.write([True, True], auto_start=True)
    assert card.device.drive_enabled()


def test_the_done_event_comes_with_every_acquisition_and_not_when_one_is_stopped(card) -> None:
    task, done, seen = card.inputs("Dev1/ai0", 50), threading.Semaphore(0), []

    def ended(_: object, code: int, data: object) -> int:
        seen.append(code)
        done.release()
        return 0

    task.register_done_event(ended)
    for _ in range(3):
        task.start()
        task.wait_until_done()
        task.stop()
        assert done.acquire(timeout=20)
    task.timing.cfg_samp_clk_timing(1000.0, sample_mode=AcquisitionType.CONTINUOUS)
    task.start()
    task.read(10)
    task.stop()
    assert not done.acquire(timeout=0.05) and seen == [0, 0, 0]
