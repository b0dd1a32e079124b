"""Several devices in one system: each its own clock, no route without a cable, nothing done to a neighbour."""

from __future__ import annotations

import contextlib
import warnings
from collections.abc import Iterator
from typing import Any

import nidaqmx
import numpy as np
import pytest
from nidaqmx import constants as ni
from nidaqmx.errors import DaqError, DaqResourceWarning
from nidaqmx.system import Device, System
from nidaqmx.system.watchdog import WatchdogTask

from rig import load_rig, open_backend
from rig.simulated.backend import CLOCK_ERRORS
from tests.rig.simulated.conftest import Bench

RATE_HZ = 5000.0


class Devices(Bench):
    """Tasks on a rig's devices; what a test closed or a reset ended is left."""

    def close(self) -> None:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DaqResourceWarning)
            for task in self.tasks:
                with contextlib.suppress(DaqError):
                    task.close()

    def force(self) -> nidaqmx.Task:
        task = self.task("master")
        task.ai_channels.add_ai_voltage_chan("Dev1/ai7", min_val=-10.0, max_val=10.0)
        return clocked(task, samples=200_000)

    def count(self, counter: str, terminal: str, source: str) -> nidaqmx.Task:
        task = self.task(f"count {counter[-1]}")
        task.ci_channels.add_ci_count_edges_chan(counter).ci_count_edges_term = terminal
        return clocked(task, source)


def clocked(task: nidaqmx.Task, source: str = "", samples: int = 100_000) -> nidaqmx.Task:
    mode = ni.AcquisitionType.CONTINUOUS
    task.timing.cfg_samp_clk_timing(RATE_HZ, source=source, sample_mode=mode, samps_per_chan=samples)
    return task


@pytest.fixture
def devices(bench_with) -> Iterator[Any]:
    """Make the devices of a rig, with what ``[wiring]`` of the bench plants."""
    opened = []

    def make(rig: str, wiring: str = "") -> Devices:
        backend = open_backend(bench_with(wiring), load_rig(rig).config)
        opened.extend((backend, Devices(backend)))
        return opened[-1]

    yield make
    for thing in reversed(opened):
        thing.close()


@pytest.fixture
def thesis(devices) -> Devices:
    return devices("thesis")


def test_an_output_on_its_own_timebase_drifts_and_one_on_the_shared_clock_does_not(thesis) -> None:
    wanted = 100_000
    for source, ahead in (("", CLOCK_ERRORS[2]), ("/Dev1/ai/SampleClock", 0.0)):
        output = thesis.task(f"output{len(source)}")
        output.ao_channels.add_ao_voltage_chan("Dev3/ao3", min_val=-1.0, max_val=1.0)
        clocked(output, source, 1000).write(np.zeros(1000), auto_start=False)
        output.triggers.start_trigger.cfg_dig_edge_start_trig("/Dev1/ai/StartTrigger")
        force = thesis.force()
        output.start()
        force.start()
        force.read(wanted, timeout=60.0)
        generated = thesis.device.tasks[output.name].output.generated
        assert generated - wanted == pytest.approx(ahead * wanted, abs=1.01)
        force.close()
        output.close()


def test_without_the_rtsi_cable_no_clock_goes_from_card_to_card(devices, refused) -> None:
    task = devices("thesis", "rtsi = false").count("Dev2/ctr0", "/Dev2/PFI39", "/Dev1/ai/SampleClock")
    with refused(-89125):
        task.start()


def test_a_chassis_and_a_card_need_a_wire_and_with_it_sample_together(devices, refused, bridge) -> None:
    both = devices("chassis_and_card")
    direct = both.count("Dev1/ctr0", "/Dev1/PFI8", "/cDAQ1/ai/SampleClock")
    with refused(-89125):
        direct.start()
    direct.close()
    counted = both.count("Dev1/ctr0", "/Dev1/PFI8", "/Dev1/PFI5")
    bridge(force := both.task("force"))
    clocked(force)
    counted.start()
    force.start()
    force.read(100, timeout=1.0)
    assert counted.in_stream.total_samp_per_chan_acquired == 0  # the clock is not on the wire yet
    force.stop()
    force.export_signals.export_signal(ni.Signal.SAMPLE_CLOCK, "/cDAQ1Mod4/PFI5")
    force.start()
    force.read(500, timeout=1.0)
    assert counted.in_stream.total_samp_per_chan_acquired == 500


def test_a_reset_touches_its_own_device_only(thesis) -> None:
    held = thesis.task("held")
    held.ao_channels.add_ao_voltage_chan("Dev3/ao1", min_val=-5.0, max_val=5.0)
    held.write(2.5, auto_start=True)
    counter = thesis.pulses(1000.0, "Dev2/ctr1")
    counter.start()
    Device("Dev2", grpc_options=thesis.options()).reset_device()
    assert thesis.device.output_v["Dev3/ao1"] == 2.5 and list(thesis.device.tasks) == ["held"]
    Device("Dev3", grpc_options=thesis.options()).reset_device()
    assert thesis.device.output_v["Dev3/ao1"] == 0.0


def test_every_device_answers_for_itself(thesis) -> None:
    names = System.remote(thesis.options()).devices.device_names
    assert list(names) == ["Dev1", "SC1Mod1", "Dev2", "Dev3"]
    of = {name: Device(name, grpc_options=thesis.options()) for name in names}
    assert [of[name].product_type for name in names] == ["PCI-6034E", "SCXI-1520", "PCI-6602", "PCI-6733"]
    assert len(of["Dev2"].ci_physical_chans) == 8 and len(of["Dev3"].ao_physical_chans) == 8
    assert all(channel.name.startswith("Dev2/") for channel in of["Dev2"].ci_physical_chans)
    with pytest.raises(DaqError):
        Device("Dev4", grpc_options=thesis.options()).product_type  # noqa: B018


def test_an_output_card_makes_a_million_samples_a_second_and_no_more(thesis, refused) -> None:
    task = thesis.task("fast")
    task.ao_channels.add_ao_voltage_chan("Dev3/ao0")
    task.timing.cfg_samp_clk_timing(1e6)
    with refused(-200332):
        task.timing.cfg_samp_clk_timing(1.01e6)


@pytest.mark.parametrize(
    ("make", "code"),
    [
        (lambda task: task.ao_channels.add_ao_voltage_chan("Dev2/ao0"), -200170),  # a counter card has no outputs
        (lambda task: task.ci_channels.add_ci_count_edges_chan("Dev3/ctr2"), -200170),
        (lambda task: task.ai_channels.add_ai_voltage_chan("Dev4/ai0"), -200220),
        (lambda task: task.ci_channels.add_ci_count_edges_chan("SC1Mod1/ai0"), -200431),
    ],
)
def test_what_a_card_does_not_have_is_refused_by_the_drivers_code(thesis, make: Any, code: int, refused) -> None:
    with refused(code):
        make(thesis.task("wrong"))


def test_cards_without_a_watchdog_refuse_one(thesis) -> None:
    for name in ("Dev1", "Dev2", "Dev3"):
        with pytest.raises(DaqError):
            WatchdogTask(name, f"dog_{name}", timeout=0.5, grpc_options=thesis.options())
