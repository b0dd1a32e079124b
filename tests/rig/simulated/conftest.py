"""The real client on a virtual device, and channels with every argument given."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import nidaqmx
import pytest
from nidaqmx import constants as ni
from nidaqmx.errors import DaqError

from rig.config import load_rig


class Bench:
    """Real tasks on a virtual device, all cleared at the end."""

    def __init__(self, backend: Any) -> None:
        self.device, self._channel, self._tasks = backend.device, backend._channel, []

    def task(self, name: str = "") -> nidaqmx.Task:
        task = nidaqmx.Task(name, grpc_options=nidaqmx.GrpcSessionOptions(self._channel, name))
        self._tasks.append(task)
        return task

    def close(self) -> None:
        for task in self._tasks:
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
