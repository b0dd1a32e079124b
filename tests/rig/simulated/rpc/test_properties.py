"""Properties of devices, channels and tasks, waveforms and converter codes, through the real client."""

from __future__ import annotations

import numpy as np
import pytest
from nidaqmx import constants as ni
from nidaqmx.grpc_session_options import GrpcSessionOptions
from nidaqmx.system import System


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
    ramp, inputs = card.task(), card.task()
    ramp.ao_channels.add_ao_voltage_chan("Dev1/ao0")
    ramp.timing.cfg_samp_clk_timing(1000.0, sample_mode=ni.AcquisitionType.CONTINUOUS)
    ramp.write(np.arange(100) * 0.01)
    inputs.ai_channels.add_ai_voltage_chan("Dev1/ai1:2")  # the first is wired to ao0
    inputs.timing.cfg_samp_clk_timing(1000.0, sample_mode=ni.AcquisitionType.CONTINUOUS)
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
    outputs, inputs = card.task(), card.task()
    outputs.ao_channels.add_ao_voltage_chan("Dev1/ao0")
    outputs.write(1.0, auto_start=True)
    inputs.ai_channels.add_ai_voltage_chan("Dev1/ai1:2")
    inputs.timing.cfg_samp_clk_timing(1000.0, samps_per_chan=3)
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
