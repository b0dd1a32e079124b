"""Counters of the virtual device that measure pulses, buffered and on demand, and put out pulses that were written."""

from __future__ import annotations

import numpy as np
import pytest
from nidaqmx import constants as ni
from nidaqmx.types import CtrFreq, CtrTime

MEASURED = {
    "freq": (800.0, "ci_freq_term", {}),
    "period": (1 / 800.0, "ci_period_term", {}),
    "pulse_width": (0.25 / 800.0, "ci_pulse_width_term", {}),
    "pulse_width low": (0.75 / 800.0, "ci_pulse_width_term", {"starting_edge": ni.Edge.FALLING}),
    "freq ticks": (125_000.0, "ci_freq_term", {"units": ni.FrequencyUnits.TICKS}),
}


@pytest.mark.parametrize("what", MEASURED)
def test_a_counter_measures_the_pulses_on_its_terminal(what, card) -> None:
    value, terminal, more = MEASURED[what]
    counter = card.task()
    channel = getattr(counter.ci_channels, f"add_ci_{what.split()[0]}_chan")("Dev1/ctr1", **more)
    assert getattr(channel, terminal) == "/Dev1/PFI4"  # gate of counter 1
    setattr(channel, terminal, "/Dev1/PFI12")
    card.pulses(800.0, duty_cycle=0.25).start()
    assert counter.read() == pytest.approx(value, rel=1e-12)
    counter.timing.cfg_implicit_timing(samps_per_chan=20)
    assert counter.read(20) == pytest.approx([value] * 20, rel=1e-12)


def test_counters_that_wait_since_an_earlier_trial_begin_with_the_new_one(card) -> None:
    train, long = card.pulses(800.0), card.inputs("Dev1/ai0", 3000)
    train.start()
    long.start()
    long.read(3000)  # the trial before has 2400 pulses
    train.stop()
    long.stop()
    edges, periods = card.task(), card.task()
    edges.ci_channels.add_ci_count_edges_chan("Dev1/ctr1").ci_count_edges_term = "/Dev1/PFI12"
    periods.ci_channels.add_ci_period_chan("Dev1/ctr2").ci_period_term = "/Dev1/PFI12"
    periods.timing.cfg_implicit_timing(samps_per_chan=4)
    edges.start()
    periods.start()
    train.start()
    assert periods.read(4) == pytest.approx([1 / 800.0] * 4)
    assert card.device.bench.now_s == pytest.approx(5 / 800.0, abs=2e-3) and edges.read() == 5


def test_the_last_period_of_a_train_is_measured_too(card) -> None:
    train, counter = card.pulses(800.0, count=4), card.task()
    counter.ci_channels.add_ci_period_chan("Dev1/ctr1").ci_period_term = "/Dev1/PFI12"
    counter.timing.cfg_implicit_timing(samps_per_chan=3)
    counter.start()
    train.start()
    assert counter.read(3, timeout=1.0) == pytest.approx([1 / 800.0] * 3)


def test_an_encoder_counts_from_the_start_of_its_task(cdaq, encoder, bridge) -> None:
    cdaq.device.lines["cDAQ1Mod4/port0/line7"] = True
    force, counts = cdaq.task(), cdaq.task()
    bridge(force)
    force.timing.cfg_samp_clk_timing(5000, sample_mode=ni.AcquisitionType.CONTINUOUS)
    encoder(counts, initial_angle=7.0)
    counts.timing.cfg_samp_clk_timing(5000, source="/cDAQ1/ai/SampleClock", sample_mode=ni.AcquisitionType.CONTINUOUS)
    force.start()
    for volts in (0.0, 1.0, 0.5):  # the hammer is at 0.3 rad a volt, an edge later
        cdaq.device.output_v["cDAQ1Mod2/ao0"] = volts
        force.read(10)
    counts.start()
    cdaq.device.output_v["cDAQ1Mod2/ao0"] = 1.0
    force.read(10)
    read = counts.read(10)
    assert read[0] == 7.0 and read[5] == pytest.approx(7.0 - 163840 / (2 * np.pi) * 0.3 * 0.5, abs=1.0)


def test_pairs_of_a_pulse_by_frequency_time_and_ticks(card) -> None:
    counters = [card.task() for _ in range(3)]
    adds = [counters[i].ci_channels for i in range(3)]
    channels = [
        adds[0].add_ci_pulse_chan_freq("Dev1/ctr1", min_val=100.0, max_val=1e4),
        adds[1].add_ci_pulse_chan_time("Dev1/ctr2"),
        adds[2].add_ci_pulse_chan_ticks("Dev1/ctr3"),
    ]
    for channel, term in zip(channels, ("freq", "time", "ticks"), strict=True):
        setattr(channel, f"ci_pulse_{term}_term", "/Dev1/Ctr0InternalOutput")
    card.pulses(800.0, duty_cycle=0.25).start()
    by_frequency, by_time, by_ticks = (counter.read() for counter in counters)
    assert (by_frequency.freq, by_frequency.duty_cycle) == pytest.approx((800.0, 0.25), rel=1e-12)
    assert (by_time.high_time, by_time.low_time) == pytest.approx((0.25 / 800, 0.75 / 800), rel=1e-12)
    assert (by_ticks.high_tick, by_ticks.low_tick) == (31_250, 93_750)


def test_written_pulses_follow_each_other_and_none_is_lost_at_a_change(card) -> None:
    output, counter, edges = card.pulses(1000.0), card.task(), card.task()
    output.write([CtrFreq(1000.0, 0.2), CtrFreq(1000.0, 0.3), CtrFreq(1000.0, 0.4)], auto_start=False)
    channel = counter.ci_channels.add_ci_pulse_width_chan("Dev1/ctr1")
    channel.ci_pulse_width_term = "/Dev1/PFI12"
    counter.timing.cfg_implicit_timing(samps_per_chan=6)
    counting = edges.ci_channels.add_ci_count_edges_chan("Dev1/ctr2")
    counting.ci_count_edges_term = "/Dev1/PFI12"
    edges.start()
    counter.start()
    output.start()
    np.testing.assert_allclose(counter.read(6), 1e-3 * np.array([0.2, 0.3, 0.4] * 2), rtol=1e-9)
    seen = edges.read()
    assert seen >= 7
    output.write(CtrFreq(100.0, 0.5))
    card.advance(5000)  # 1 s
    assert edges.read() == pytest.approx(seen + 100, abs=1)


def test_a_pulse_by_time_starts_the_task_and_a_short_one_is_refused(card, refused) -> None:
    task = card.task()
    task.co_channels.add_co_pulse_chan_time("Dev1/ctr0")
    assert task.write(CtrTime(high_time=0.001, low_time=0.002)) == 1
    task.wait_until_done(1.0)
    assert card.device.bench.edge / card.device.bench.rate_hz == pytest.approx(0.001, abs=2e-3)
    task.stop()
    with refused(-200077):
        task.write(CtrTime(high_time=1e-9, low_time=0.002))


def test_a_large_range_measurement_takes_the_paired_counter_too(card, refused) -> None:
    wide, other = card.task(), card.task()
    channel = wide.ci_channels.add_ci_freq_chan(
        "Dev1/ctr0", min_val=1e5, max_val=1e6, meas_method=ni.CounterFrequencyMethod.LARGE_RANGE_2_COUNTERS
    )
    assert channel.ci_freq_term == "/Dev1/PFI8"  # source of counter 0
    wide.control(ni.TaskMode.TASK_COMMIT)
    other.ci_channels.add_ci_count_edges_chan("Dev1/ctr1")
    with refused(-50103):
        other.start()


def test_encoders_have_the_default_terminals_of_the_card_and_may_measure_a_length(card) -> None:
    task = card.task()
    channel = task.ci_channels.add_ci_lin_encoder_chan("Dev1/ctr2", dist_per_pulse=1e-3, initial_pos=0.5)
    assert (channel.ci_encoder_a_input_term, channel.ci_encoder_b_input_term) == ("/Dev1/PFI0", "/Dev1/PFI2")
    assert channel.ci_meas_type == ni.UsageTypeCI.POSITION_LINEAR_ENCODER
    channel.ci_encoder_b_input_term = "/Dev1/PFI1"  # where the hammer's scale is wired
    still = task.read()
    assert still == pytest.approx(0.5 + 1e-3 * round((still - 0.5) / 2.5e-4) / 4, rel=1e-12)


def test_counters_named_by_the_9401_have_its_default_terminals(cdaq) -> None:
    task = cdaq.task()
    channel = task.ci_channels.add_ci_count_edges_chan("cDAQ1Mod4/ctr1")
    assert channel.ci_count_edges_term == "/cDAQ1Mod4/PFI4"
    assert task.read() == 0
