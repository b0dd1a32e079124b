"""A counter output on a sample clock: each of its ticks loads the next pulses written, which begin with the next pulse.

The first ones are loaded when the task starts; a buffer that is used up begins again. Where no clock comes the first
pulses go on.
"""

from __future__ import annotations

from rig.simulated import daqmx
from rig.simulated.device.state import DeviceState
from rig.simulated.device.task import SimulatedTask
from rig.simulated.signals.pulses import pulse_train
from rig.simulated.timing.engine import engine_of


def load_pulses(device: DeviceState, task: SimulatedTask, edge: int, n: int) -> None:
    """Load what the clock's ticks on the next n edges of the bench call for."""
    engine, pulses = engine_of(device, task), task.pulses
    if engine is None:
        return
    first = max(engine.passed(edge), task.progress.first_tick)
    for at in engine.edges(first, max(engine.passed(edge + n), first)):
        train, now_s = pulse_train(task), float(at) / device.bench.rate_hz
        pulses.passed, pulses.next_s = train.passed_at(now_s), train.next_after(now_s)
        load(task, pulses.loaded + 1)


def load(task: SimulatedTask, number: int) -> None:
    """Load the pulses of sample ``number`` of the buffer."""
    pulses = task.pulses
    if pulses.written is None:
        return
    pulses.loaded = number
    high_s, low_s = pulses.written[number % pulses.written.shape[0]]
    name = task.channels[0].name
    task.properties["Chan", name, daqmx.CO_PULSE_FREQ] = float(1 / (high_s + low_s))
    task.properties["Chan", name, daqmx.CO_PULSE_DUTY_CYC] = float(high_s / (high_s + low_s))
