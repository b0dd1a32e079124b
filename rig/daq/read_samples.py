"""The next samples of every input task as one block, and the driver's own count of samples.

Force comes calibrated and as measured, counts as whole numbers; a count that is not whole is a fault.
"""

from __future__ import annotations

import numpy as np
from nidaqmx.stream_readers import AnalogMultiChannelReader, CounterReader
from numpy.typing import NDArray

from rig.backend import Block
from rig.configuration.rig_file import RigConfig
from rig.daq import analog_inputs, tasks
from rig.daq.faults import translated
from rig.daq.task_set import TaskSet
from rig.errors import HardwareFault


def next_block(made: TaskSet, config: RigConfig, first_sample: int, n_samples: int, timeout_s: float) -> Block:
    """Return the next ``n_samples`` of every input; ``first_sample`` is the number of the first of them."""
    values = np.empty((1 + len(config.channels), n_samples))
    with translated("read", analog_inputs.MASTER):
        reader = AnalogMultiChannelReader(made[analog_inputs.MASTER].in_stream)
        reader.verify_array_shape = False  # saves a round trip to the server per read
        reader.read_many_sample(values, n_samples, timeout_s)
    if config.force.kind == "bridge":
        force_n, raw = values[0], analog_inputs.volts_of_force(config, values[0])
    else:
        force_n, raw = analog_inputs.force_of_volts(config, values[0]), values[0]
    further = [analog_inputs.channel_of_volts(channel, values[k]) for k, channel in enumerate(config.channels, 1)]
    count = np.empty((n_samples, len(config.encoders)), dtype=np.int64)
    for column, encoder in enumerate(config.encoders):
        count[:, column] = _ticks(made, tasks.encoder_task_name(encoder), n_samples, timeout_s)
    if tasks.OPPOSITE in made and config.key_opposite is not None:
        per_tick = config.key_opposite.sign * 2 * np.pi / config.encoders[0].counts_per_revolution
        further.append(np.asarray(_ticks(made, tasks.OPPOSITE, n_samples, timeout_s) * per_tick, dtype=np.float64))
    exposures = _ticks(made, tasks.EDGES, n_samples, timeout_s) if tasks.EDGES in made else None
    return Block(first_sample, force_n, raw, count, exposures, np.column_stack(further) if further else None)


def _ticks(made: TaskSet, name: str, n_samples: int, timeout_s: float) -> NDArray[np.int64]:
    ticks = np.empty(n_samples)
    with translated("read", name):
        reader = CounterReader(made[name].in_stream)
        reader.verify_array_shape = False
        reader.read_many_sample_double(ticks, n_samples, timeout_s)
    whole = np.rint(ticks)
    if not np.array_equal(whole, ticks):
        raise HardwareFault(f"{name}: counts are not whole numbers; the task is not in ticks", phase="read")
    return whole.astype(np.int64)


def positions(made: TaskSet, config: RigConfig) -> dict[str, tuple[int, int]]:
    """Return by input task the samples per channel the driver has handed out and acquired since its start."""
    found = {}
    encoders = map(tasks.encoder_task_name, config.encoders)
    for name in (analog_inputs.MASTER, *encoders, tasks.OPPOSITE, tasks.EDGES):
        if name in made:
            with translated("read", name):
                stream = made[name].in_stream
                found[name] = (int(stream.curr_read_pos), int(stream.total_samp_per_chan_acquired))
    return found
