"""What programs of NI's client do with the calls that are answered: sequences, values and refusals of the hardware."""

from __future__ import annotations

import numpy as np
import pytest
from nidaqmx import constants as ni

from rig.simulated.rpc.messages import request_class

FINITE, CONTINUOUS = ni.AcquisitionType.FINITE, ni.AcquisitionType.CONTINUOUS


def test_input_and_output_with_clocks_of_their_own_start_on_one_trigger(card) -> None:
    inputs, outputs = card.inputs("Dev1/ai1", 1000, 10_000.0), card.task()  # wired to ao0
    outputs.ao_channels.add_ao_voltage_chan("Dev1/ao0")
    outputs.timing.cfg_samp_clk_timing(1000.0, sample_mode=FINITE, samps_per_chan=50)
    outputs.triggers.start_trigger.cfg_dig_edge_start_trig("/Dev1/ai/StartTrigger")
    outputs.write([float(i) / 10 for i in range(50)], auto_start=True)
    assert card.device.output_v.get("Dev1/ao0", 0.0) == 0.0
    inputs.start()
    read = np.array(inputs.read(1000))
    # value k is put out at ms k and read from the next sample on, ten times; it stays at the last
    k = np.minimum(np.maximum(np.arange(1000) - 1, 0) // 10, 49)
    np.testing.assert_allclose(read, k / 10, atol=20 / 2**16)
    assert outputs.is_task_done()


def test_an_exported_clock_drives_another_task(card, refused) -> None:
    inputs, counts = card.inputs("Dev1/ai2", 40), card.task()
    inputs.export_signals.export_signal(ni.Signal.SAMPLE_CLOCK, "/Dev1/PFI4")
    counts.ci_channels.add_ci_count_edges_chan("Dev1/ctr1")
    counts.timing.cfg_samp_clk_timing(1000.0, source="/Dev1/PFI4", samps_per_chan=40)
    counts.start()
    assert len(inputs.read(40)) == len(counts.read(40)) == 40
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


def test_levels_go_to_the_lines_they_are_written_for(card, refused) -> None:
    out = card.task()
    out.do_channels.add_do_chan("Dev1/port0/line3:0", line_grouping=ni.LineGrouping.CHAN_PER_LINE)
    out.write([True, False, True, True], auto_start=True)
    assert [card.device.lines[f"Dev1/port0/line{k}"] for k in range(4)] == [True, True, False, True]
    other = card.task()
    other.do_channels.add_do_chan("Dev1/port0/line1")
    out.control(ni.TaskMode.TASK_RESERVE)
    with refused(-50103):
        other.write(True, auto_start=True)
    with refused(-200452):
        out.timing.cfg_samp_clk_timing(1000.0)


def test_one_value_cannot_be_written_to_several_channels(card) -> None:
    volts = card.task("volts")
    volts.ao_channels.add_ao_voltage_chan("Dev1/ao0:1")
    request = request_class("WriteAnalogScalarF64")(value=1, auto_start=True)
    request.task.name = "volts"
    with pytest.raises(Exception, match="one value for 2 channels"):
        card.service.handle("WriteAnalogScalarF64", request)


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
        task.timing.cfg_samp_clk_timing(value, sample_mode=CONTINUOUS)
