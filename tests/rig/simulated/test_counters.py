"""Counters of the virtual device: encoders and edges, from the start of their tasks, on their default terminals."""

from __future__ import annotations

import numpy as np
import pytest
from nidaqmx import constants as ni


def test_counters_that_wait_since_an_earlier_trial_begin_with_the_new_one(card) -> None:
    train, long = card.pulses(800.0), card.inputs("Dev1/ai0", 3000)
    train.start()
    long.start()
    long.read(3000)  # the trial before has 2400 pulses
    train.stop()
    long.stop()
    edges = card.task()
    edges.ci_channels.add_ci_count_edges_chan("Dev1/ctr1").ci_count_edges_term = "/Dev1/PFI12"
    edges.start()
    train.start()
    card.advance(round(4.5 / 800.0 * card.device.bench.rate_hz))
    assert edges.read() == 5


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


def test_counters_named_by_the_9401_have_its_default_terminals(cdaq) -> None:
    task = cdaq.task()
    channel = task.ci_channels.add_ci_count_edges_chan("cDAQ1Mod4/ctr1")
    assert channel.ci_count_edges_term == "/cDAQ1Mod4/PFI4"
    assert task.read() == 0
