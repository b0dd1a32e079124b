"""The device's time goes on by itself: what a client sees that does not read.

Analog start and reference triggers, and digital pause triggers, by a ramp that an output makes.

Start, reference and repeated triggers of the virtual device, by pulses on its terminals; times by a ramp.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from nidaqmx import constants as ni
from nidaqmx.errors import DaqError, DaqReadError

from rig.configuration.rig_file import load_rig
from rig.simulated.bench.bench_time import PacedClock
from rig.simulated.device.state import FaultPlan, parse_faults


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


def test_the_first_sample_of_a_loop_is_what_the_output_was_at(card) -> None:
    out, read = card.task(), card.inputs("Dev1/ai1", 3)
    out.ao_channels.add_ao_voltage_chan("Dev1/ao0")
    out.write(2.5)
    assert read.read(3) == pytest.approx([2.5] * 3, abs=1e-3)


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


def test_a_drive_that_a_clocked_line_enables_follows_edge_by_edge(cdaq, bridge) -> None:
    enable, out, cell = cdaq.task(), cdaq.task(), cdaq.task()
    enable.do_channels.add_do_chan("cDAQ1Mod4/port0/line7")
    enable.timing.cfg_samp_clk_timing(5000.0, "/cDAQ1/ai/SampleClock", samps_per_chan=300)
    enable.write([False] * 100 + [True] * 100 + [False] * 100)
    out.ao_channels.add_ao_voltage_chan("cDAQ1Mod2/ao0")
    out.write(1.0)
    bridge(cell)
    cell.timing.cfg_samp_clk_timing(5000.0, samps_per_chan=300)
    enable.start()
    cell.start()
    force = np.array(cell.read(300))  # an edge and 40.03 samples later
    np.testing.assert_allclose(force[[139, 143, 239, 243]], [0.05, 12.05, 12.05, 0.05], atol=1e-3)


def test_what_is_written_before_the_start_follows_what_was_written_before_it(card) -> None:
    task = card.task()
    task.ao_channels.add_ao_voltage_chan("Dev1/ao1")
    task.timing.cfg_samp_clk_timing(1000.0, sample_mode=CONTINUOUS, samps_per_chan=200)
    task.out_stream.output_buf_size = 200
    for run, (first, second) in enumerate(((1.0, 2.0), (3.0, 4.0))):
        task.write(np.full(100, first), auto_start=False)
        task.write(np.full(100, second), auto_start=False)
        task.start()
        card.advance(50)
        assert card.device.output_v["Dev1/ao1"] == first, run
        card.advance(100)
        assert card.device.output_v["Dev1/ao1"] == second, run
        task.control(ni.TaskMode.TASK_UNRESERVE) if run else task.stop()


def test_a_waveform_begins_so_long_after_its_device_was_made(card) -> None:
    card.device.bench.clock.made_s = 1.7e9  # 2023-11-14 22:13:20 UTC
    task = card.inputs("Dev1/ai0")
    task.start()
    task.read(500)
    assert str(task.read_waveform(10).timing.start_time) == "2023-11-14 22:13:20.500000+00:00"


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
    task = bench.inputs("Dev1/ai0", 500)
    task.start()
    for passed_s, acquired in ((0.1, 100), (0.3, 400), (0.3, 500)):
        wait(passed_s)
        assert task.in_stream.total_samp_per_chan_acquired == pytest.approx(acquired, abs=2)
    assert task.is_task_done()
    assert len(task.read(500, timeout=0)) == 500


def test_a_reader_that_is_late_has_lost_samples(paced, refused) -> None:
    bench, wait = paced
    task = bench.inputs("Dev1/ai0")
    task.start()
    for _ in range(26):  # 10 kS are kept; calls about anything find the device where it is
        wait(0.4)
        assert task.timing.samp_clk_rate == 1000.0
    with refused(-200279):
        task.read(10)


def test_polling_comes_to_an_end_on_the_virtual_clock(card) -> None:
    task = card.inputs("Dev1/ai0", 100)
    task.start()
    end = time.monotonic() + 30
    while task.in_stream.total_samp_per_chan_acquired < 100:
        assert time.monotonic() < end
    while not task.is_task_done():
        assert time.monotonic() < end
    assert len(task.read(100, timeout=0)) == 100


ENTERING, LEAVING = ni.WindowTriggerCondition1.ENTERING_WINDOW, ni.WindowTriggerCondition1.LEAVING_WINDOW
CONTINUOUS = ni.AcquisitionType.CONTINUOUS


def saw(card: Any, samples: int = 1000) -> Any:
    """A saw of 1 mV a sample, each 1 ms, on ao0, which ai1 is wired to."""
    ramp = card.task()
    ramp.ao_channels.add_ao_voltage_chan("Dev1/ao0")
    ramp.timing.cfg_samp_clk_timing(1000.0, sample_mode=CONTINUOUS, samps_per_chan=samples)
    ramp.write(np.arange(samples) * 1e-3)
    return ramp


def inputs(card: Any, samples: int, *more: str, **settings: Any) -> Any:
    task = card.task()
    for channel in ("Dev1/ai1", *more):
        task.ai_channels.add_ai_voltage_chan(channel, min_val=-5.0, max_val=5.0)
    task.timing.cfg_samp_clk_timing(1000.0, samps_per_chan=samples, **settings)
    return task


@pytest.mark.parametrize(
    ("configure", "first_v"),
    [
        (lambda t: t.cfg_anlg_edge_start_trig("Dev1/ai1", ni.Slope.RISING, 0.3), 0.301),
        (lambda t: t.cfg_anlg_edge_start_trig("Dev1/ai1", ni.Slope.FALLING, 0.3), 0.001),  # where the saw falls back
        (lambda t: t.cfg_anlg_window_start_trig(0.5, 0.4, "Dev1/ai1", ENTERING), 0.401),
        (lambda t: t.cfg_anlg_window_start_trig(0.5, 0.4, "Dev1/ai1", LEAVING), 0.502),
    ],
)
def test_sampling_begins_where_the_signal_crosses(card: Any, configure: Callable[[Any], None], first_v: float) -> None:
    task = inputs(card, 10)
    configure(task.triggers.start_trigger)
    task.start()
    assert task.in_stream.total_samp_per_chan_acquired == 0
    saw(card).start()
    read = np.array(task.read(10))
    np.testing.assert_allclose(read, first_v + 1e-3 * np.arange(10), atol=1.2e-3)
    assert task.is_task_done()


def test_a_crossing_counts_only_after_the_signal_has_been_beyond_the_hysteresis(card: Any) -> None:
    task, ramp = inputs(card, 5), card.task()
    ramp.ao_channels.add_ao_voltage_chan("Dev1/ao0")
    ramp.timing.cfg_samp_clk_timing(1000.0, sample_mode=CONTINUOUS, samps_per_chan=1000)
    shallow = np.full(1000, 0.4)
    shallow[100:200], shallow[500:600] = 0.35, 0.1  # the first dip is within the hysteresis, the second beyond it
    ramp.write(np.where(np.arange(1000) % 1000 >= 600, 0.5, shallow))
    task.triggers.start_trigger.cfg_anlg_edge_start_trig("Dev1/ai1", ni.Slope.RISING, 0.38)
    task.triggers.start_trigger.anlg_edge_hyst = 0.2
    ramp.start()
    with pytest.raises(DaqError, match="-200560"):
        ramp.wait_until_done(0.01)  # from 0 V to the first sample is a crossing, too
    task.start()
    with pytest.raises(DaqReadError, match="-200284"):
        task.read(5, timeout=0.45)
    np.testing.assert_allclose(task.read(5), 0.5, atol=1e-3)


def test_without_a_signal_no_trigger_comes(card: Any) -> None:
    task = inputs(card, 10)
    task.triggers.start_trigger.cfg_anlg_edge_start_trig("APFI0", ni.Slope.RISING, 0.3)
    saw(card).start()
    with pytest.raises(DaqReadError, match="-200284"):
        task.read(10, timeout=0.5)


@pytest.mark.parametrize(
    ("source", "code"), [("Dev1/ai2", -200131), ("Dev1/ai3", -200265)], ids=["second channel", "not in the task"]
)
def test_a_card_compares_its_first_channel_alone(card: Any, source: str, code: int, refused) -> None:
    task = inputs(card, 10, "Dev1/ai2")
    task.triggers.start_trigger.cfg_anlg_edge_start_trig(source, ni.Slope.RISING, 0.3)
    with refused(code):
        task.start()


def paused_by(task: Any, source: str, when: ni.Level) -> None:
    pause = task.triggers.pause_trigger
    pause.trig_type, pause.dig_lvl_src, pause.dig_lvl_when = ni.TriggerType.DIGITAL_LEVEL, source, when


@pytest.mark.parametrize("when", [ni.Level.HIGH, ni.Level.LOW])
def test_no_sample_is_taken_while_a_pulse_is_at_the_level(card: Any, when: ni.Level) -> None:
    task, gate = inputs(card, 200), card.pulses(10.0, duty_cycle=0.3, initial_delay=0.05)
    paused_by(task, "/Dev1/PFI12", when)
    saw(card).start()
    task.start()
    gate.start()
    read = np.array(task.read(200))
    assert read.size == 200 and task.is_task_done()
    phase = (read + 1e-3 - 0.05) % 0.1  # of the pulse, by the ramp, which tells the time
    high = (phase < 0.03) & (read > 0.05)
    assert np.count_nonzero(high if when == ni.Level.HIGH else ~high) <= 0.03 * read.size  # one sample each edge
    assert np.ptp(np.diff(read)) > 0.02  # there are gaps


def test_a_line_that_shares_the_pin_pauses_a_generation(card: Any) -> None:
    ramp, line = saw(card), card.task()
    line.do_channels.add_do_chan("Dev1/port1/line0")
    paused_by(ramp, "/Dev1/PFI0", ni.Level.HIGH)
    ramp.start()
    card.advance(100)
    at = ramp.out_stream.total_samp_per_chan_generated
    line.write(True)
    card.advance(50)
    still = ramp.out_stream.total_samp_per_chan_generated
    line.write(False)
    card.advance(50)
    assert at > 50 and still - at <= 2 and ramp.out_stream.total_samp_per_chan_generated - still >= 48


def test_what_cannot_pause_is_refused_by_name(card: Any, refused) -> None:
    both = inputs(card, 100)
    both.triggers.reference_trigger.cfg_dig_edge_ref_trig("/Dev1/PFI8", pretrigger_samples=30)
    paused_by(both, "/Dev1/PFI0", ni.Level.HIGH)
    with refused(-200628):
        both.start()
    counted = card.task()
    counted.ci_channels.add_ci_count_edges_chan("Dev1/ctr1")
    paused_by(counted, "/Dev1/PFI0", ni.Level.HIGH)
    with pytest.raises(DaqError, match="pause trigger") as refused:
        counted.start()
    assert refused.value.error_code == -200452


COUNTED, CLOCK = "Dev1/ctr1", "/Dev1/Ctr0InternalOutput"


@pytest.mark.parametrize(
    "what",
    [
        lambda task: task.triggers.start_trigger.cfg_dig_edge_start_trig(CLOCK, ni.Edge.FALLING),
        lambda task: task.triggers.reference_trigger.cfg_dig_edge_ref_trig("/Dev1/PFI8", 30, ni.Edge.FALLING),
        lambda task: task.timing.cfg_samp_clk_timing(100.0, CLOCK, ni.Edge.FALLING),
        lambda task: setattr(task.triggers.arm_start_trigger, "dig_edge_edge", ni.Edge.FALLING),
        lambda task: setattr(task.triggers.start_trigger, "retriggerable", True),
        lambda task: task.ci_channels.add_ci_count_edges_chan(COUNTED, edge=ni.Edge.FALLING),
    ],
    ids=["start", "reference", "clock", "arm", "level again", "count"],
)
def test_what_would_happen_with_every_rise_instead_is_refused(what: Any, card: Any, request: Any) -> None:
    counts = request.node.callspec.id == "count"
    task = card.task() if counts else inputs(card, 100)
    if request.node.callspec.id == "level again":
        task.triggers.start_trigger.cfg_anlg_edge_start_trig("Dev1/ai1", ni.Slope.RISING, 0.3)
    what(task)
    with pytest.raises(DaqError, match="-200452"):
        task.start()


def test_the_trigger_configured_last_is_the_one_that_counts(card: Any) -> None:
    task = inputs(card, 10)
    start = task.triggers.start_trigger
    start.cfg_anlg_edge_start_trig("Dev1/ai1", ni.Slope.RISING, 0.3)
    start.cfg_dig_edge_start_trig("/Dev1/PFI12")
    assert start.trig_type == ni.TriggerType.DIGITAL_EDGE
    task.start()
    saw(card).start()
    with pytest.raises(DaqReadError, match="-200284"):  # the level has come, an edge has not
        task.read(10, timeout=0.8)
    task.stop()
    start.cfg_anlg_edge_start_trig("Dev1/ai1", ni.Slope.RISING, 0.3)
    assert start.trig_type == ni.TriggerType.ANALOG_EDGE
    assert len(task.read(10, timeout=2.0)) == 10


def test_a_pulse_on_a_terminal_starts_an_acquisition(card) -> None:
    task = inputs(card, 10)
    task.triggers.start_trigger.cfg_dig_edge_start_trig("/Dev1/PFI12")
    task.start()
    saw(card, 5000).start()
    card.pulses(1.0, initial_delay=0.2).start()
    read = np.array(task.read(10))
    np.testing.assert_allclose(read, 0.200 + 1e-3 * np.arange(-1, 9), atol=2e-4)


@pytest.mark.parametrize(("on", "first_v", "within_v"), [("a level", 0.470, 1.2e-3), ("a pulse", 0.469, 2e-4)])
def test_a_reference_trigger_keeps_what_came_before_it(card, on: str, first_v: float, within_v: float) -> None:
    task = inputs(card, 100)
    reference = task.triggers.reference_trigger
    if on == "a level":
        reference.cfg_anlg_edge_ref_trig("Dev1/ai1", 30, ni.Slope.RISING, 0.5)
    else:
        reference.cfg_dig_edge_ref_trig("/Dev1/PFI12", pretrigger_samples=30)
    saw(card, 5000).start()
    task.start()
    card.pulses(1.0, initial_delay=0.5).start()
    with pytest.raises(DaqReadError, match="-200284"):
        task.read(100, timeout=0.3)
    read = np.array(task.read(ni.READ_ALL_AVAILABLE))
    assert read.size == 100 and task.is_task_done() and task.in_stream.avail_samp_per_chan == 0
    np.testing.assert_allclose(read, first_v + 1e-3 * np.arange(100), atol=within_v)


def test_a_retriggered_acquisition_comes_with_every_pulse(card) -> None:
    task = inputs(card, 4)
    task.triggers.start_trigger.cfg_dig_edge_start_trig("/Dev1/Ctr0InternalOutput")
    task.triggers.start_trigger.retriggerable = True
    saw(card, 5000).start()
    task.start()
    card.pulses(50.0, initial_delay=0.1).start()
    read = np.array(task.read(12)).reshape(3, 4)
    np.testing.assert_allclose(read, 0.099 + 0.02 * np.arange(3)[:, None] + 1e-3 * np.arange(4), atol=2e-4)
    assert not task.is_task_done()
