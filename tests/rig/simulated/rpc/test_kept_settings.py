"""Settings the virtual device cannot act on: kept and answered as the driver does, and their tasks refused, by name."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import nidaqmx
import numpy as np
import pytest
from nidaqmx import constants as ni
from nidaqmx.error_codes import DAQmxErrors
from nidaqmx.errors import DaqError
from nidaqmx.system import Device, PhysicalChannel
from nidaqmx.system.storage import PersistedChannel, PersistedScale, PersistedTask
from nidaqmx.system.watchdog import DOExpirationState, WatchdogTask

SAMPLES = 100


@pytest.fixture
def voltage(card: Any) -> nidaqmx.Task:
    """A clocked voltage input."""
    task = card.task("voltage")
    task.ai_channels.add_ai_voltage_chan("Dev1/ai0")
    task.timing.cfg_samp_clk_timing(1000.0, samps_per_chan=SAMPLES)
    return task


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


def test_a_trigger_on_what_is_no_input_is_refused_at_once(voltage: nidaqmx.Task) -> None:
    with pytest.raises(DaqError) as refused:
        voltage.triggers.start_trigger.cfg_anlg_edge_start_trig("Dev1/ai99")
    assert refused.value.error_code == -200170


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


def test_what_the_system_has_not_saved_is_refused_by_the_drivers_codes(card: Any) -> None:
    options = nidaqmx.GrpcSessionOptions(card._channel, "")
    for stored, code in (
        (PersistedChannel("none", grpc_options=options), -200882),
        (PersistedScale("none", grpc_options=options), -200378),
        (PersistedTask("none", grpc_options=options), -200485),
        (PhysicalChannel("Dev1/ai1234", grpc_options=options), -200170),
    ):
        with pytest.raises(DaqError) as refused:
            _ = stored.ai_term_cfgs if isinstance(stored, PhysicalChannel) else stored.author
        assert refused.value.error_code == code


def test_a_card_answers_for_its_calibration_and_its_channels(card: Any) -> None:
    options = nidaqmx.GrpcSessionOptions(card._channel, "")
    device = Device("Dev1", grpc_options=options)
    assert device.cal_dev_temp == 0.0 and device.ext_cal_recommended_interval == 24
    device.self_cal()
    ai = {name: PhysicalChannel(f"Dev1/{name}", grpc_options=options).ai_term_cfgs for name in ("ai0", "ai8")}
    both = [ni.TerminalConfiguration.RSE, ni.TerminalConfiguration.NRSE]
    assert ai["ai0"] == [*both, ni.TerminalConfiguration.DIFF] and ai["ai8"] == both


def test_an_exported_signal_on_no_terminal_is_refused(voltage: nidaqmx.Task) -> None:
    assert voltage.export_signals.samp_clk_output_behavior == ni.ExportAction.PULSE
    voltage.export_signals.start_trig_output_term = "RTSI"
    with pytest.raises(DaqError) as refused:
        voltage.control(ni.TaskMode.TASK_VERIFY)
    assert refused.value.error_code == -89121
    voltage.export_signals.start_trig_output_term = "PFI4"
    refused_to_start(voltage, "START_TRIG_OUTPUT_TERM")
