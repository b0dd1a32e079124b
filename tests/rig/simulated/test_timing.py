"""The device's time goes on by itself: what a client sees that does not read, and when a trigger begins a task."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from nidaqmx import constants as ni
from nidaqmx.errors import DaqError

from rig import load_rig
from rig.simulated.bench.clock import PacedClock
from rig.simulated.device.faults import parse_faults
from rig.simulated.device.state import FaultPlan

CONTINUOUS = ni.AcquisitionType.CONTINUOUS


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


def test_an_input_on_demand_reads_what_the_cell_feels_and_what_is_wrong_with_it(cdaq, bridge) -> None:
    cell = cdaq.task()
    bridge(cell)
    cdaq.device.bench.hung_n = 7.0
    assert cell.read() == pytest.approx(7.05, abs=1e-3)
    assert cell.read() == pytest.approx(7.05, abs=1e-3)
    cdaq.device.faults = FaultPlan(parse_faults("bridge-open@0/0"))
    assert cell.read() > 1000.0


def test_the_filter_of_the_bridge_delays_whatever_began_the_trial(cdaq, bridge) -> None:
    cdaq.device.lines["cDAQ1Mod4/port0/line7"] = True
    step, cell = cdaq.task(), cdaq.task()
    step.ao_channels.add_ao_voltage_chan("cDAQ1Mod2/ao0")
    step.timing.cfg_samp_clk_timing(5000.0, sample_mode=CONTINUOUS, samps_per_chan=1000)
    step.write(np.repeat([0.0, 1.0], [100, 900]))
    bridge(cell)
    cell.timing.cfg_samp_clk_timing(5000.0, samps_per_chan=200)
    step.start()
    cell.start()
    force = np.array(cell.read(200))  # felt from edge 101 on, 40.03 samples later
    np.testing.assert_allclose(force[[140, 143]], [0.05, 12.05], atol=1e-3)


def test_counts_move_while_nobody_reads(paced) -> None:
    bench, wait = paced
    task = bench.inputs("Dev1/ai0", 500)
    task.start()
    for passed_s, acquired in ((0.1, 100), (0.3, 400), (0.3, 500)):
        wait(passed_s)
        assert task.in_stream.total_samp_per_chan_acquired == pytest.approx(acquired, abs=2)
    assert task.is_task_done()
    assert len(task.read(500, timeout=0)) == 500


def test_a_pulse_on_a_terminal_starts_an_acquisition(card) -> None:
    task, ramp = card.task(), card.task()
    task.ai_channels.add_ai_voltage_chan("Dev1/ai1", min_val=-5.0, max_val=5.0)  # wired to ao0
    task.timing.cfg_samp_clk_timing(1000.0, samps_per_chan=10)
    task.triggers.start_trigger.cfg_dig_edge_start_trig("/Dev1/PFI12")
    task.start()
    ramp.ao_channels.add_ao_voltage_chan("Dev1/ao0")
    ramp.timing.cfg_samp_clk_timing(1000.0, sample_mode=CONTINUOUS, samps_per_chan=5000)
    ramp.write(np.arange(5000) * 1e-3)
    ramp.start()
    card.pulses(1.0, initial_delay=0.2).start()
    read = np.array(task.read(10))
    np.testing.assert_allclose(read, 0.200 + 1e-3 * np.arange(-1, 9), atol=2e-4)


def _clock_on_falling_edges(card: Any) -> None:
    card.inputs("Dev1/ai1").timing.cfg_samp_clk_timing(1000.0, "/Dev1/PFI3", active_edge=ni.Edge.FALLING)


@pytest.mark.parametrize(
    "ask",
    [
        _clock_on_falling_edges,
        lambda card: card.inputs("Dev1/ai1").triggers.start_trigger.cfg_dig_edge_start_trig(
            "/Dev1/PFI12", ni.Edge.FALLING
        ),
        lambda card: setattr(card.inputs("Dev1/ai1").triggers.arm_start_trigger, "dig_edge_edge", ni.Edge.FALLING),
        lambda card: card.task().ci_channels.add_ci_count_edges_chan("Dev1/ctr1", edge=ni.Edge.FALLING),
    ],
    ids=["clock", "start", "arm", "count"],
)
def test_what_would_happen_with_every_rise_instead_is_refused(ask: Callable[[Any], None], card: Any) -> None:
    with pytest.raises(DaqError, match="-200452"):
        ask(card)
