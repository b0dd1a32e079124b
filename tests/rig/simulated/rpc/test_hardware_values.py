"""Values and refusals as the hardware gives them, to clients that are not ours."""

from __future__ import annotations

import threading
import time

import pytest
from nidaqmx.constants import AcquisitionType, LineGrouping, Signal, TriggerType
from nidaqmx.errors import DaqError


def test_what_is_not_simulated_is_refused_with_the_drivers_code(card, refused) -> None:
    with refused(-200431):
        card.task().ai_channels.add_ai_thrmstr_chan_iex("Dev1/ai0")
    with refused(-200220):
        card.task().ai_channels.add_ai_thrmstr_chan_iex("TS1Mod1/ai0")
    task = card.task()
    task.ai_channels.add_ai_voltage_chan("Dev1/ai0")
    task.timing.cfg_samp_clk_timing(1000.0)
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
    task = card.task()
    task.ai_channels.add_ai_voltage_chan("Dev1/ai0:1")
    task.timing.cfg_samp_clk_timing(1000.0, samps_per_chan=50)
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
    task = card.task()
    task.ai_channels.add_ai_voltage_chan("Dev1/ai0")
    task.timing.cfg_samp_clk_timing(1000.0)
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
