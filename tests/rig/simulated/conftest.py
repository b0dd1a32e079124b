"""The real client on a virtual device, and channels with every argument given."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import nidaqmx
import pytest
from nidaqmx import constants as ni
from nidaqmx.errors import DaqError

from rig import load_rig
from rig.simulated.rpc.service import in_process_channel
from rig.simulated.timing import advance


def _mode(samples: int | None) -> dict[str, Any]:
    return {"sample_mode": ni.AcquisitionType.CONTINUOUS} if samples is None else {"samps_per_chan": samples}


class Bench:
    """Real tasks on a virtual device, all cleared at the end."""

    def __init__(self, backend: Any) -> None:
        self.device, self.service, self.tasks = backend.device, backend.service, []
        self._channel = in_process_channel(backend.service)

    def options(self, name: str = "", **more: Any) -> nidaqmx.GrpcSessionOptions:
        """Options of a session of this bench."""
        return nidaqmx.GrpcSessionOptions(self._channel, name, **more)

    def task(self, name: str = "") -> nidaqmx.Task:
        task = nidaqmx.Task(name, grpc_options=self.options(name))
        self.tasks.append(task)
        return task

    def forget(self, task: nidaqmx.Task) -> None:
        """Leave a task that the device has ended: nothing is left to clear."""
        self.tasks.remove(task)
        task._handle = None

    def inputs(
        self, channels: str, samples: int | None = None, rate_hz: float = 1000.0, name: str = ""
    ) -> nidaqmx.Task:
        """Voltage inputs with a sample clock: so many samples, or without end."""
        task = self.task(name)
        task.ai_channels.add_ai_voltage_chan(channels)
        task.timing.cfg_samp_clk_timing(rate_hz, **_mode(samples))
        return task

    def pulses(self, freq: float, counter: str = "Dev1/ctr0", count: int | None = None, **more: float) -> nidaqmx.Task:
        """A train out of a counter, /Dev1/PFI12 that of the first: so many pulses, or without end."""
        train = self.task()
        train.co_channels.add_co_pulse_chan_freq(counter, freq=freq, **more)
        train.timing.cfg_implicit_timing(**_mode(count))
        return train

    def advance(self, edges: int) -> None:
        """Let edges of the bench pass."""
        advance(self.device, edges)

    def close(self) -> None:
        for task in self.tasks:
            task.close()


@pytest.fixture
def bench_of(make_backend) -> Iterator[Callable[[str], Bench]]:
    """Make a bench for a built-in rig file."""
    made: list[Bench] = []

    def make(rig: str) -> Bench:
        made.append(Bench(make_backend(load_rig(rig).config)))
        return made[-1]

    yield make
    for bench in made:
        bench.close()


@pytest.fixture
def cdaq(bench_of) -> Bench:
    return bench_of("virtual")


@pytest.fixture
def card(bench_of) -> Bench:
    return bench_of("pcie6363")


@pytest.fixture
def refused() -> Callable[[int], Any]:
    """Expect a driver status."""
    return lambda code: pytest.raises(DaqError, match=str(code))


@pytest.fixture
def bridge() -> Callable[..., None]:
    """Add a force bridge to a task."""

    def add(task: nidaqmx.Task, channel: str = "cDAQ1Mod1/ai0", **changes: Any) -> None:
        arguments = {
            "min_val": -20.0,
            "max_val": 111.2,
            "units": ni.ForceUnits.NEWTONS,
            "voltage_excit_val": 5.0,
            "first_electrical_val": 0.0,
            "second_electrical_val": 2.0,
            "electrical_units": ni.BridgeElectricalUnits.MILLIVOLTS_PER_VOLT,
            "first_physical_val": 0.0,
            "second_physical_val": 111.2,
            "physical_units": ni.BridgePhysicalUnits.NEWTONS,
            **changes,
        }
        task.ai_channels.add_ai_force_bridge_two_point_lin_chan(channel, **arguments)

    return add


@pytest.fixture
def encoder() -> Callable[..., Any]:
    """Add an encoder, wired to the hammer's scale, to a task."""

    def add(task: nidaqmx.Task, counter: str = "cDAQ1Mod3/ctr0", **changes: Any) -> Any:
        arguments = {
            "decoding_type": ni.EncoderType.X_4,
            "units": ni.AngleUnits.TICKS,
            "pulses_per_rev": 81920,
            **changes,
        }
        channel = task.ci_channels.add_ci_ang_encoder_chan(counter, **arguments)
        channel.ci_encoder_a_input_term, channel.ci_encoder_b_input_term = "/cDAQ1Mod3/PFI4", "/cDAQ1Mod3/PFI5"
        return channel

    return add
