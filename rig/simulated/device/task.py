"""Tasks of the virtual device: channels, clock, trigger, state and sample buffer, without any time of their
own.

States follow the driver's model: unreserved → committed (resources taken) → running; a stop leads back to
where the task was before its start. A buffer knows how many samples were acquired and read, so that
overwriting is found by counting.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from rig.simulated import status
from rig.simulated.product.inventory import PhysicalChannel
from rig.simulated.status import DaqStatusError

TaskType = Literal["AI", "AO", "CI", "CO", "DI", "DO"]
State = Literal["unreserved", "committed", "running"]
FINITE, CONTINUOUS = 10178, 10123
REGENERATION, NO_REGENERATION = 0x1453, 10158
RETRIGGERABLE = 0x190F


@dataclass(eq=False)
class Channel:
    """A virtual channel: its name in the task, the physical channel, and the settings it was created with."""

    name: str
    physical: PhysicalChannel
    settings: dict[str, Any]


@dataclass(frozen=True)
class SampleClock:
    """Sample clock of a task: rate after coercion, source ("" is the task's own), mode and samples per
    channel."""

    rate_hz: float
    source: str
    mode: int
    samples: int


class Buffer:
    """Input buffer of a task: a fixed size, samples acquired, samples read."""

    def __init__(self, size: int, columns: int, *, forgets: bool = False) -> None:
        self.size = size
        self.forgets = forgets
        """Whether it loses its oldest samples rather than data, as before a reference trigger."""
        self.acquired = 0
        self.read = 0
        self.overwritten = False
        self._blocks: list[NDArray[np.float64]] = []
        self._columns = columns

    @property
    def available(self) -> int:
        """Samples per channel waiting to be read."""
        return self.acquired - self.read

    def put(self, values: NDArray[np.float64]) -> None:
        """Add n samples, shape (n, columns); more unread samples than the buffer holds means loss."""
        self._blocks.append(values)
        self.acquired += values.shape[0]
        if self.available > self.size:
            if self.forgets:
                self.take(self.available - self.size)
            else:
                self.overwritten = True

    def take(self, n: int) -> NDArray[np.float64]:
        """Remove and return the oldest n samples, shape (n, columns)."""
        if self.overwritten:
            raise DaqStatusError(status.SAMPLES_NO_LONGER_AVAILABLE, samples_read=0)
        line = np.concatenate(self._blocks) if self._blocks else np.empty((0, self._columns))
        self._blocks = [line[n:]] if line.shape[0] > n else []
        self.read += n
        return line[:n]


@dataclass(eq=False)
class SimulatedTask:
    """One task of the virtual device."""

    name: str
    type: TaskType | None = None
    channels: list[Channel] = field(default_factory=list)
    clock: SampleClock | None = None
    start_trigger: str = ""
    arm_trigger: str = ""
    attributes: dict[tuple[str, str, int], Any] = field(default_factory=dict)
    state: State = "unreserved"
    committed: bool = False
    live: bool = False
    """Running, and its trigger has come."""
    buffer: Buffer | None = None
    output: NDArray[np.float64] | None = None
    generated: int = 0
    capacity: int = 0
    """Samples per channel the output buffer holds."""
    since_s: float = 0.0
    """Bench time at which it became live, s."""
    since_tick: int = 0
    """Tick of its clock at which it became live."""
    counted: int = 0
    """Edges that had passed on its terminal when it became live."""
    trigger_edges: int = 0
    """Edges that had passed on its trigger's terminal when it began to wait."""
    before_trigger: int = 0
    """Samples acquired or generated before the last trigger, by a task that is triggered again and again."""
    exported: set[str] = field(default_factory=set)
    """Terminals it has sent its signals to, relative to the device."""
    ref_trigger: str = ""
    """Terminal of the reference trigger, relative to the device; "" for none."""
    pretrigger: int = 0
    """Samples that are kept from before the reference trigger."""
    ref_edges: int | None = None
    """Edges that had passed on its terminal when the pretrigger samples were complete."""
    ref_end: int | None = None
    """Samples acquired by the end of the acquisition, once the reference trigger has come."""
    changes: frozenset[str] = frozenset()
    """Lines whose changes are its sample clock."""
    pulses: int | None = 1
    """Pulses a counter output puts out; None: without end."""
    implicit: bool = False
    """The pulses a counter measures are its sample clock."""
    pulses_before: int = 0
    next_pulse_s: float | None = None
    """Pulses put out, and when the next one came, as pulses were written to the running output; None before."""
    pulse_highs_s: NDArray[np.float64] | None = None
    """High times of the pulses written, one a pulse, repeated; None for all like the channel's."""
    pulse_end_s: float = float("inf")
    finished: bool = False
    """A counter output has put out its last pulse."""
    error: int = 0
    """Status that ended a generation."""

    def add_channel(self, kind: TaskType, channel: Channel) -> None:
        """Add a channel; refuses a mixture of types and a second counter."""
        if self.state == "running":
            raise DaqStatusError(status.TASK_RUNNING, f"Task: {self.name}")
        if self.type not in (None, kind):
            raise DaqStatusError(status.TASK_MIXES_TYPES, f"Task: {self.name}")
        if kind == "CI" and self.channels:
            raise DaqStatusError(status.ONE_COUNTER_PER_TASK, f"Task: {self.name}")
        if any(channel.name == other.name or channel.physical == other.physical for other in self.channels):
            raise DaqStatusError(status.DUPLICATE_TASK, f"Channel {channel.name} is in the task already")
        self.type = kind
        self.channels.append(channel)

    def setting(self, category: str, channel: str, attribute: int, default: Any) -> Any:
        """Return a property that was set, or ``default``."""
        return self.attributes.get((category, channel, attribute), default)

    @property
    def buffer_size(self) -> int:
        """Samples per channel the input buffer holds: what was asked for, at least the driver's minimum."""
        clock = self.clock
        asked = int(self.setting("Buffer", "", 0x186C, 0))
        if asked:
            return asked
        if clock is None or (clock.mode == FINITE and not self.retriggerable):
            return clock.samples if clock else 1
        # NI-DAQmx Help, "How is buffer size determined?": at least 1 kS, 10 kS, 100 kS, 1 MS by rate
        floor = 1_000 if clock.rate_hz <= 100 else 10_000 if clock.rate_hz <= 10_000 else 100_000
        return max(clock.samples, floor if clock.rate_hz <= 1e6 else 1_000_000)

    @property
    def all_there_is(self) -> int:
        """Samples that reading all of them means: what is there, or all a finite task will have."""
        if self.clock is None or self.buffer is None:
            return 1
        if self.clock.mode != FINITE or self.retriggerable or (self.ref_trigger and self.to_do <= 0):
            return self.buffer.available
        return self.clock.samples - (0 if self.ref_trigger else self.buffer.read)

    def remaining(self) -> float:
        """Samples a finite input task will still acquire; infinite when it is continuous."""
        return self.to_do if self.buffer is not None else float("inf")

    @property
    def so_far(self) -> int:
        """Samples acquired or generated since the start."""
        return self.buffer.acquired if self.buffer is not None else self.generated

    @property
    def ticked(self) -> int:
        """Samples acquired or generated since its trigger."""
        return self.so_far - self.before_trigger

    @property
    def to_do(self) -> float:
        """Samples a finite task will still acquire or generate; infinite when it is continuous."""
        if self.clock is None or self.clock.mode != FINITE or (self.ref_trigger and self.ref_end is None):
            return float("inf")
        if self.ref_end is not None:
            return self.ref_end - self.so_far
        return self.clock.samples - self.ticked

    def next_output(self, n: int) -> NDArray[np.float64]:
        """Return the next samples of a generation, at most n, shape (m, channels); fewer when it ends.

        A generation longer than the buffer repeats the buffer, as the driver's regeneration does; where regeneration
        is not allowed it ends with an error when the written samples are used up.
        """
        if self.output is None or self.clock is None:
            return np.empty((0, len(self.channels)))
        total = self.clock.samples if self.clock.mode == FINITE else np.iinfo(np.int64).max
        m = int(min(n, total - self.ticked))
        if not self.regenerates and self.generated + m > self.output.shape[0]:
            m = self.output.shape[0] - self.generated
            self.error, self.live = status.GENERATION_STOPPED, False
        rows = (self.generated + np.arange(m)) % self.output.shape[0]
        self.generated += m
        return self.output[rows]

    @property
    def waits_for(self) -> str:
        """Terminal of the trigger that starts it, relative to the device; "" for none."""
        return self.start_trigger or self.arm_trigger

    @property
    def retriggerable(self) -> bool:
        """Whether a finite task begins again with each edge of its start trigger."""
        return bool(self.start_trigger and self.setting("Trig", "", RETRIGGERABLE, False))

    @property
    def regenerates(self) -> bool:
        """Whether written samples may be put out again."""
        return bool(self.setting("Write", "", REGENERATION, 0) != NO_REGENERATION)

    @property
    def done(self) -> bool:
        """Whether a finite task has acquired or generated all its samples, or the task does not run."""
        if self.state != "running":
            return True
        if self.retriggerable:
            return False
        return self.finished if self.type == "CO" else self.to_do <= 0
