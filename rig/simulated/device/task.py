"""A task of the virtual device: its channels, clock, triggers, state and buffers. It has no time of its own.

States follow the driver's model: unreserved → committed (resources taken) → running; a stop leads back to where the
task was before its start. A running task is *live* once its trigger has come. A buffer counts samples per channel since
the start of its task (acquired and read, or generated), so that overwriting is found by counting.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from rig.simulated import daqmx
from rig.simulated.product import PhysicalChannel
from rig.simulated.status import Code, DaqStatusError, refuse_any


@dataclass(eq=False)
class Triggers:
    """Terminals of the triggers, relative to the device; "" for none."""

    start: str = ""
    arm_start: str = ""

    @property
    def begin(self) -> str:
        """Terminal of the trigger with which sampling begins: start trigger, or arm start trigger of a counter."""
        return self.start or self.arm_start


class InputBuffer:
    """Input buffer of a task: a fixed size, samples acquired, samples read."""

    def __init__(self, size: int, columns: int) -> None:
        self.size = size
        self.acquired = 0
        self.read = 0
        self.overwritten = False
        self._blocks: list[NDArray[np.float64]] = []
        self._columns = columns

    @property
    def available(self) -> int:
        return self.acquired - self.read

    def append(self, values: NDArray[np.float64]) -> None:
        """Add n samples, shape (n, columns); more unread samples than the buffer holds means loss."""
        self._blocks.append(values)
        self.acquired += values.shape[0]
        if self.available > self.size:
            self.overwritten = True

    def take(self, n: int) -> NDArray[np.float64]:
        """Remove and return the oldest n unread samples, shape (n, columns), one column per channel; raise the driver's
        status where unread ones were overwritten."""
        if self.overwritten:
            raise DaqStatusError(Code.SAMPLES_NO_LONGER_AVAILABLE, samples_read=0)
        stored = np.concatenate(self._blocks) if self._blocks else np.empty((0, self._columns))
        self._blocks = [stored[n:]] if stored.shape[0] > n else []
        self.read += n
        return stored[:n]


@dataclass(eq=False)
class OutputBuffer:
    """Output buffer of a task: the samples written, and how many have been generated."""

    samples: NDArray[np.float64] | None = None
    """Shape (n, channels); None before the first write."""
    generated: int = 0
    """Samples per channel generated since the start."""

    @property
    def n_written(self) -> int:
        return 0 if self.samples is None else self.samples.shape[0]


TaskType = Literal["AI", "AO", "CI", "CO", "DO"]
TaskState = Literal["unreserved", "committed", "running"]


@dataclass(eq=False)
class Channel:
    """A virtual channel: its name in the task, the physical channel, and the settings it was created with."""

    name: str
    physical: PhysicalChannel
    settings: dict[str, Any]


@dataclass(frozen=True)
class SampleClock:
    """Sample clock: rate after coercion, source ("" is the task's own), sample mode and samples per channel."""

    rate_hz: float
    source: str
    mode: int
    samples: int


@dataclass(eq=False)
class Progress:
    """Where a task is since its start; edges and ticks are counted as the driver's counters would."""

    live: bool = False
    """Running, and its trigger has come."""
    error: int = 0
    """Status that ended the task."""
    live_since_s: float = 0.0
    """Bench time at which it became live, s."""
    first_tick: int = 0
    """Tick of its clock at which it became live."""
    initial_edges: int = 0
    """Edges that had passed on a counter's terminal, or its encoder's count, when it became live."""
    trigger_edges: int = 0
    """Edges that had passed on the trigger's terminal when the task began to wait for it."""


@dataclass(eq=False)
class PulseGeneration:
    """Pulses a counter output generates."""

    count: int | None = 1
    """None: without end."""
    drift: float = 1.0
    """Rate of the timebase it is made from, over that of the device that began the trial."""
    end_s: float = float("inf")
    finished: bool = False
    """The last pulse has been generated."""


@dataclass(eq=False)
class SimulatedTask:
    """One task of the virtual device."""

    name: str
    type: TaskType | None = None
    channels: list[Channel] = field(default_factory=list)
    properties: dict[tuple[str, str, int], Any] = field(default_factory=dict)
    """What a client has set, by category, channel and the driver's number."""
    clock: SampleClock | None = None
    """None: samples are taken or put out on demand."""
    triggers: Triggers = field(default_factory=Triggers)
    exported: set[str] = field(default_factory=set)
    """Terminals it exports its signals to, relative to the device."""
    state: TaskState = "unreserved"
    committed: bool = False
    """Whether a client has committed it, so that it keeps its resources when it stops."""
    progress: Progress = field(default_factory=Progress)
    buffer: InputBuffer | None = None
    output: OutputBuffer = field(default_factory=OutputBuffer)
    pulses: PulseGeneration = field(default_factory=PulseGeneration)

    def add_channel(self, kind: TaskType, channel: Channel) -> None:
        """Add a channel, which makes the task one of type ``kind``; refuse it in a running task, beside channels of
        another type, a second counter input, and a name or physical channel that the task has already."""
        self.refuse_while_running()
        refuse_any(
            (self.type not in (None, kind), Code.MULTI_CHAN_TYPES_IN_TASK, f"Task: {self.name}"),
            (kind == "CI" and self.channels, Code.MULTIPLE_COUNTER_INPUT_TASK, f"Task: {self.name}"),
            (
                any(channel.name == other.name or channel.physical == other.physical for other in self.channels),
                Code.DUPLICATE_TASK,
                f"Channel {channel.name} is in the task already",
            ),
        )
        self.type = kind
        self.channels.append(channel)

    def refuse_while_running(self) -> None:
        if self.state == "running":
            raise DaqStatusError(Code.CAN_NOT_PERFORM_OP_WHILE_TASK_RUNNING, f"Task: {self.name}")

    def setting(self, category: str, channel: str, number: int, default: Any) -> Any:
        return self.properties.get((category, channel, number), default)

    @property
    def is_finite(self) -> bool:
        return self.clock is not None and self.clock.mode == daqmx.FINITE

    @property
    def has_own_clock(self) -> bool:
        return self.clock is not None and not self.clock.source

    @property
    def lines(self) -> list[str]:
        return [line for channel in self.channels for line in channel.settings["lines"]]

    @property
    def counts_edges(self) -> bool:
        """Whether a counter input counts the edges on a terminal; else it reads an encoder."""
        return self.type == "CI" and "initial_count" in self.channels[0].settings

    @property
    def input_buffer_size(self) -> int:
        """Samples per channel that the driver gives the input buffer room for."""
        if self.clock is None or self.is_finite:
            return self.clock.samples if self.clock else 1
        # NI-DAQmx Help, "How is buffer size determined?": at least 1 kS, 10 kS, 100 kS, 1 MS by rate
        rate_hz = self.clock.rate_hz
        floor = 1_000 if rate_hz <= 100 else 10_000 if rate_hz <= 10_000 else 100_000  # as above
        return max(self.clock.samples, floor if rate_hz <= 1e6 else 1_000_000)

    @property
    def read_all_samples(self) -> int:
        """Samples per channel a read of all available ones returns: for a finite task, all it will acquire."""
        if self.clock is None or self.buffer is None:
            return 1
        return self.clock.samples - self.buffer.read if self.is_finite else self.buffer.available

    @property
    def total_samples(self) -> int:
        return self.buffer.acquired if self.buffer is not None else self.output.generated

    @property
    def samples_remaining(self) -> float:
        """Samples a finite task will still acquire or generate; infinite when it is continuous."""
        if self.clock is None or not self.is_finite:
            return float("inf")
        return self.clock.samples - self.total_samples

    def generate(self, n: int) -> NDArray[np.float64]:
        """Return the next samples that an output task generates, shape (m, channels), V, and count them as generated; m
        is n, or less where a finite generation ends, and 0 where nothing was written.

        A generation longer than the buffer repeats the buffer, as the driver's regeneration does.
        """
        output = self.output
        if output.samples is None or self.clock is None:
            return np.empty((0, len(self.channels)))
        m = int(min(n, self.samples_remaining))
        rows = (output.generated + np.arange(m)) % output.n_written
        output.generated += m
        return output.samples[rows]

    @property
    def is_done(self) -> bool:
        """Whether a finite task has acquired or generated all its samples, or the task does not run."""
        if self.state != "running":
            return True
        if self.clock is None and self.type in ("AI", "AO", "DO"):
            return True  # on demand there is nothing to wait for
        return self.pulses.finished if self.type == "CO" else self.samples_remaining <= 0
