"""Several devices in one system: each its own clock, no route without a cable, nothing done to a neighbour."""

from __future__ import annotations

import contextlib
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import nidaqmx
import numpy as np
import pytest
from nidaqmx import GrpcSessionOptions
from nidaqmx import constants as ni
from nidaqmx.errors import DaqError, DaqResourceWarning
from nidaqmx.system import Device, System

from rig.backend import open_backend
from rig.configuration.rig_file import load_rig
from rig.daq.tasks import session_options
from rig.simulated.backend import CLOCK_ERRORS, DEFAULT_BENCH, SimulatedBackend

RATE_HZ = 5000.0


@pytest.fixture
def system() -> Iterator[Any]:
    """Makes tasks on a rig's devices, with what ``[wiring]`` of the bench plants; closes them."""
    made: list[nidaqmx.Task] = []

    class Made:
        backend: SimulatedBackend

        def open(self, rig: str, wiring: str = "", folder: Path | None = None) -> None:
            address = "sim://"
            if wiring and folder is not None:
                bench = folder / "bench.toml"
                text = f"{DEFAULT_BENCH.read_text('utf-8')}\n[wiring]\n{wiring}\n"
                bench.write_text(text, encoding="utf-8")
                address = f"sim://?bench={bench.as_posix()}"
            self.backend = open_backend(address, load_rig(rig).config)  # type: ignore[assignment]

        @property
        def options(self) -> Any:
            return session_options(self.backend._channel)

        def task(self, name: str) -> nidaqmx.Task:
            made.append(nidaqmx.Task(name, grpc_options=GrpcSessionOptions(self.backend._channel, name)))
            return made[-1]

        def force(self, samples: int = 100_000) -> nidaqmx.Task:
            task = self.task("master")
            task.ai_channels.add_ai_voltage_chan("Dev1/ai7", min_val=-10.0, max_val=10.0)
            task.timing.cfg_samp_clk_timing(RATE_HZ, sample_mode=ni.AcquisitionType.CONTINUOUS, samps_per_chan=samples)
            return task

        def clocked_count(self, counter: str, terminal: str, source: str) -> nidaqmx.Task:
            task = self.task("count")
            task.ci_channels.add_ci_count_edges_chan(counter).ci_count_edges_term = terminal
            mode = ni.AcquisitionType.CONTINUOUS
            task.timing.cfg_samp_clk_timing(RATE_HZ, source=source, sample_mode=mode, samps_per_chan=100_000)
            return task

    found = Made()
    yield found
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DaqResourceWarning)  # of tasks that a test closed, or a reset ended
        for task in made:
            with contextlib.suppress(DaqError):
                task.close()
    found.backend.close()


def pulses(system: Any, counter: str, hz: float) -> nidaqmx.Task:
    task = system.task("pulses")
    task.co_channels.add_co_pulse_chan_freq(counter, freq=hz)
    task.timing.cfg_implicit_timing(sample_mode=ni.AcquisitionType.CONTINUOUS)
    return task


@pytest.mark.parametrize(("counter", "device"), [("Dev1/ctr0", 0), ("Dev2/ctr5", 1), ("Dev3/ctr1", 2)])
def test_the_skew_of_two_timebases_is_what_counting_one_against_the_other_finds(
    system: Any, counter: str, device: int
) -> None:
    system.open("thesis")
    made = pulses(system, counter, 100e3)
    terminal = f"/{counter.split('/')[0]}/Ctr{counter[-1]}InternalOutput"
    counted = system.clocked_count("Dev2/ctr0" if device == 1 else "Dev1/ctr1", terminal, "/Dev1/ai/SampleClock")
    if device == 2:  # no counter of the lab's is on the output card: its own second one counts
        counted.close()
        counted = system.task("count3")
        counted.ci_channels.add_ci_count_edges_chan("Dev3/ctr0").ci_count_edges_term = terminal
        counted.timing.cfg_samp_clk_timing(
            RATE_HZ, source="/Dev1/ai/SampleClock", sample_mode=ni.AcquisitionType.CONTINUOUS, samps_per_chan=100_000
        )
    made.triggers.start_trigger.cfg_dig_edge_start_trig("/Dev1/ai/StartTrigger")
    force = system.force()
    counted.start()
    made.start()
    force.start()
    n = 20_001
    values = np.asarray(counted.read(n, timeout=30.0))
    measured = (values[-1] - values[0]) / ((n - 1) / RATE_HZ) / 100e3 - 1.0
    assert measured == pytest.approx(CLOCK_ERRORS[device], abs=1.5 / (100e3 * 4))


def test_an_output_on_its_own_timebase_drifts_and_one_on_the_shared_clock_does_not(system: Any) -> None:
    system.open("thesis")
    wanted = 100_000
    for source, ahead in (("", CLOCK_ERRORS[2]), ("/Dev1/ai/SampleClock", 0.0)):
        output = system.task(f"output{len(source)}")
        output.ao_channels.add_ao_voltage_chan("Dev3/ao3", min_val=-1.0, max_val=1.0)
        mode = ni.AcquisitionType.CONTINUOUS
        output.timing.cfg_samp_clk_timing(RATE_HZ, source=source, sample_mode=mode, samps_per_chan=1000)
        output.write(np.zeros(1000), auto_start=False)
        output.triggers.start_trigger.cfg_dig_edge_start_trig("/Dev1/ai/StartTrigger")
        force = system.force(200_000)
        output.start()
        force.start()
        force.read(wanted, timeout=60.0)
        generated = output.out_stream.total_samp_per_chan_generated
        assert generated - wanted == pytest.approx(ahead * wanted, abs=1.01)
        force.close()
        output.close()


def test_without_the_rtsi_cable_no_clock_goes_from_card_to_card(system: Any, tmp_path: Path) -> None:
    system.open("thesis", "rtsi = false", tmp_path)
    task = system.clocked_count("Dev2/ctr0", "/Dev2/PFI39", "/Dev1/ai/SampleClock")
    with pytest.raises(DaqError) as refused:
        task.start()
    assert refused.value.error_code == -89125


def test_a_chassis_and_a_card_need_a_wire_and_with_it_sample_together(system: Any, tmp_path: Path) -> None:
    system.open("chassis_and_card")
    direct = system.clocked_count("Dev1/ctr0", "/Dev1/PFI8", "/cDAQ1/ai/SampleClock")
    with pytest.raises(DaqError) as refused:
        direct.start()
    assert refused.value.error_code == -89125
    direct.close()
    counted = system.clocked_count("Dev1/ctr0", "/Dev1/PFI8", "/Dev1/PFI5")
    force = system.task("force")
    force.ai_channels.add_ai_force_bridge_two_point_lin_chan(
        "cDAQ1Mod1/ai0", units=ni.ForceUnits.NEWTONS, min_val=-20.0, max_val=100.0, first_electrical_val=0.0,
        second_electrical_val=2.0, electrical_units=ni.BridgeElectricalUnits.MILLIVOLTS_PER_VOLT,
        first_physical_val=0.0, second_physical_val=111.2, physical_units=ni.BridgePhysicalUnits.NEWTONS,
        bridge_config=ni.BridgeConfiguration.FULL_BRIDGE, voltage_excit_val=5.0, nominal_bridge_resistance=350.0,
    )  # fmt: skip
    force.timing.cfg_samp_clk_timing(RATE_HZ, sample_mode=ni.AcquisitionType.CONTINUOUS, samps_per_chan=100_000)
    counted.start()
    force.start()
    force.read(100, timeout=1.0)
    assert counted.in_stream.total_samp_per_chan_acquired == 0  # the clock is not on the wire yet
    force.stop()
    force.export_signals.export_signal(ni.Signal.SAMPLE_CLOCK, "/cDAQ1Mod4/PFI5")
    force.start()
    force.read(500, timeout=1.0)
    assert counted.in_stream.total_samp_per_chan_acquired == 500


def test_a_reset_touches_its_own_device_only(system: Any) -> None:
    system.open("thesis")
    held = system.task("held")
    held.ao_channels.add_ao_voltage_chan("Dev3/ao1", min_val=-5.0, max_val=5.0)
    held.write(2.5, auto_start=True)
    counter = pulses(system, "Dev2/ctr1", 1000.0)
    counter.start()
    Device("Dev2", grpc_options=system.options).reset_device()
    assert system.backend.device.output_v["Dev3/ao1"] == 2.5
    assert "held" in system.backend.device.tasks and "pulses" not in system.backend.device.tasks
    Device("Dev3", grpc_options=system.options).reset_device()
    assert system.backend.device.output_v["Dev3/ao1"] == 0.0


def test_every_device_answers_for_itself(system: Any) -> None:
    system.open("thesis")
    names = System.remote(system.options).devices.device_names
    assert list(names) == ["Dev1", "SC1Mod1", "Dev2", "Dev3"]
    of = {name: Device(name, grpc_options=system.options) for name in names}
    assert [of[name].product_type for name in names] == ["PCI-6034E", "SCXI-1520", "PCI-6602", "PCI-6733"]
    assert of["Dev3"].ao_max_rate == 1e6  # 1 MS/s, as the card is specified
    assert len(of["Dev2"].ci_physical_chans) == 8 and len(of["Dev3"].ao_physical_chans) == 8
    assert all(channel.name.startswith("Dev2/") for channel in of["Dev2"].ci_physical_chans)
    with pytest.raises(DaqError):
        Device("Dev4", grpc_options=system.options).product_type  # noqa: B018


@pytest.mark.parametrize(
    ("make", "code"),
    [
        (lambda task: task.ao_channels.add_ao_voltage_chan("Dev2/ao0"), -200170),  # a counter card has no outputs
        (lambda task: task.ci_channels.add_ci_count_edges_chan("Dev3/ctr2"), -200170),
        (lambda task: task.ai_channels.add_ai_voltage_chan("Dev4/ai0"), -200220),
        (lambda task: task.ci_channels.add_ci_count_edges_chan("SC1Mod1/ai0"), -200431),
    ],
)
def test_what_a_card_does_not_have_is_refused_by_the_drivers_code(system: Any, make: Any, code: int) -> None:
    system.open("thesis")
    with pytest.raises(DaqError) as refused:
        make(system.task("wrong"))
    assert refused.value.error_code == code


def test_cards_without_a_watchdog_refuse_one(system: Any) -> None:
    from nidaqmx.system.watchdog import WatchdogTask

    system.open("thesis")
    for name in ("Dev1", "Dev2", "Dev3"):
        with pytest.raises(DaqError):
            WatchdogTask(name, f"dog_{name}", timeout=0.5, grpc_options=GrpcSessionOptions(system.backend._channel, ""))
