"""Start, reference and repeated triggers of the virtual device, by pulses on its terminals; times by a ramp."""

from __future__ import annotations

import numpy as np
import pytest
from nidaqmx import constants as ni
from nidaqmx.errors import DaqReadError

CONTINUOUS = ni.AcquisitionType.CONTINUOUS


def pulses(card, rate_hz: float, initial_delay: float = 0.0, counter: str = "Dev1/ctr0", count: int | None = None):
    """A train on /Dev1/PFI12 (of ctr0)."""
    train = card.task()
    train.co_channels.add_co_pulse_chan_freq(counter, freq=rate_hz, initial_delay=initial_delay)
    if count is None:
        train.timing.cfg_implicit_timing(sample_mode=CONTINUOUS)
    else:
        train.timing.cfg_implicit_timing(samps_per_chan=count)
    return train


def ramp_into(card, rate_hz: float):
    """A ramp of 1 mV a sample on ao0, which ai1 is wired to, and an input on ai1 with a clock of its own."""
    ramp, inputs = card.task(), card.task()
    ramp.ao_channels.add_ao_voltage_chan("Dev1/ao0")
    ramp.timing.cfg_samp_clk_timing(rate_hz, sample_mode=CONTINUOUS, samps_per_chan=5000)
    ramp.write(np.arange(5000) * 1e-3)
    inputs.ai_channels.add_ai_voltage_chan("Dev1/ai1", min_val=-5.0, max_val=5.0)
    return ramp, inputs


def test_a_pulse_on_a_terminal_starts_an_acquisition(card) -> None:
    ramp, inputs = ramp_into(card, 1000.0)
    inputs.timing.cfg_samp_clk_timing(1000.0, samps_per_chan=10)
    inputs.triggers.start_trigger.cfg_dig_edge_start_trig("/Dev1/PFI12")
    inputs.start()
    ramp.start()
    pulses(card, 1.0, initial_delay=0.2).start()
    read = np.array(inputs.read(10))
    np.testing.assert_allclose(read, 0.200 + 1e-3 * np.arange(-1, 9), atol=2e-4)


def test_a_reference_trigger_keeps_what_came_before_it(card) -> None:
    ramp, inputs = ramp_into(card, 1000.0)
    inputs.timing.cfg_samp_clk_timing(1000.0, samps_per_chan=100)
    inputs.triggers.reference_trigger.cfg_dig_edge_ref_trig("/Dev1/PFI12", pretrigger_samples=30)
    ramp.start()
    inputs.start()
    train = pulses(card, 1.0, initial_delay=0.5)
    train.start()
    with pytest.raises(DaqReadError, match="-200284"):
        inputs.read(100, timeout=0.3)
    read = np.array(inputs.read(ni.READ_ALL_AVAILABLE))
    assert inputs.is_task_done() and inputs.in_stream.avail_samp_per_chan == 0
    np.testing.assert_allclose(read, 0.500 + 1e-3 * np.arange(-31, 69), atol=2e-4)


def test_a_retriggered_acquisition_comes_with_every_pulse(card) -> None:
    ramp, inputs = ramp_into(card, 1000.0)
    inputs.timing.cfg_samp_clk_timing(1000.0, samps_per_chan=4)
    inputs.triggers.start_trigger.cfg_dig_edge_start_trig("/Dev1/Ctr0InternalOutput")
    inputs.triggers.start_trigger.retriggerable = True
    ramp.start()
    inputs.start()
    pulses(card, 50.0, initial_delay=0.1).start()
    read = np.array(inputs.read(12)).reshape(3, 4)
    np.testing.assert_allclose(read, 0.099 + 0.02 * np.arange(3)[:, None] + 1e-3 * np.arange(4), atol=2e-4)
    assert not inputs.is_task_done()
