"""The device's time goes on by itself: what a client sees that does not read."""

from __future__ import annotations

import time

import pytest
from nidaqmx.constants import AcquisitionType

from rig.configuration.rig_file import load_rig
from rig.simulated.bench.clock import PacedClock


@pytest.fixture
def paced(make_backend):
    """A card whose clock follows a wall clock that the test moves."""
    from tests.rig.simulated.conftest import Bench

    wall = [0.0]

    def wait(duration_s: float) -> None:
        wall[0] += duration_s

    bench = Bench(make_backend(load_rig("pcie6363").config, clock=PacedClock(1.0, wall_s=lambda: wall[0], wait=wait)))
    yield bench, wait
    bench.close()


def test_what_is_written_on_demand_is_read_on_demand_at_once(card) -> None:
    out, read, several = card.task(), card.task(), card.task()
    out.ao_channels.add_ao_voltage_chan("Dev1/ao0")
    read.ai_channels.add_ai_voltage_chan("Dev1/ai1")
    several.ai_channels.add_ai_voltage_chan("Dev1/ai1:2")
    for volts in (2.5, -1.25, 0.0):
        out.write(volts)
        assert read.read() == pytest.approx(volts, abs=1e-3)
        assert several.read() == pytest.approx([volts, 0.0], abs=1e-3)
        assert read.read(3) == pytest.approx([volts] * 3, abs=1e-3)


def test_an_input_on_demand_follows_the_bench_behind_an_output_on_demand(cdaq, bridge) -> None:
    out, cell = cdaq.task(), cdaq.task()
    bridge(cell)
    cdaq.device.lines["cDAQ1Mod4/port0/line7"] = True
    out.ao_channels.add_ao_voltage_chan("cDAQ1Mod2/ao0")
    for volts in (1.0, 0.25):
        out.write(volts)
        assert cell.read() == pytest.approx(0.05 + 12.0 * volts, abs=1e-3)


def test_counts_move_while_nobody_reads(paced) -> None:
    bench, wait = paced
    task = bench.task()
    task.ai_channels.add_ai_voltage_chan("Dev1/ai0")
    task.timing.cfg_samp_clk_timing(1000.0, sample_mode=AcquisitionType.FINITE, samps_per_chan=500)
    task.start()
    for passed_s, acquired in ((0.1, 100), (0.3, 400), (0.3, 500)):
        wait(passed_s)
        assert task.in_stream.total_samp_per_chan_acquired == pytest.approx(acquired, abs=2)
    assert task.is_task_done()
    assert len(task.read(500, timeout=0)) == 500


def test_a_reader_that_is_late_has_lost_samples(paced, refused) -> None:
    bench, wait = paced
    task = bench.task()
    task.ai_channels.add_ai_voltage_chan("Dev1/ai0")
    task.timing.cfg_samp_clk_timing(1000.0, sample_mode=AcquisitionType.CONTINUOUS)
    task.start()
    for _ in range(26):  # 10 kS are kept; calls about anything find the device where it is
        wait(0.4)
        assert task.timing.samp_clk_rate == 1000.0
    with refused(-200279):
        task.read(10)


def test_polling_comes_to_an_end_on_the_virtual_clock(card) -> None:
    task = card.task()
    task.ai_channels.add_ai_voltage_chan("Dev1/ai0")
    task.timing.cfg_samp_clk_timing(1000.0, sample_mode=AcquisitionType.FINITE, samps_per_chan=100)
    task.start()
    end = time.monotonic() + 30
    while task.in_stream.total_samp_per_chan_acquired < 100:
        assert time.monotonic() < end
    while not task.is_task_done():
        assert time.monotonic() < end
    assert len(task.read(100, timeout=0)) == 100
