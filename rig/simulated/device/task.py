"""A task of the virtual device: its channels, timing, triggers, state and buffers. It has no time of its own.

States follow the driver's model: unreserved → committed (resources taken) → running; a stop leads back to where the
task was before its start. A running task is *live* once its trigger has come. A buffer counts samples per channel since
the start of its task (acquired and read, or generated), so that overwriting is found by counting. An analog trigger
finds the sample at which an input crosses a level, or enters or leaves a window: hardware compares between the samples,
the virtual device at them, so that it comes up to one sample later.

A task may log its samples to a file on the server's side (TDMS), as the driver's logging does. Values are written
scaled, one TDMS channel a channel of the task, with start time, interval and unit where they are known. Needs npTDMS
(extra ``tdms``).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from rig.simulated import daqmx
from rig.simulated.product import PhysicalChannel
from rig.simulated.status import Code, DaqStatusError, refuse_any

if TYPE_CHECKING:
    from nptdms import TdmsWriter


OFF, LOG, LOG_AND_READ = 10231, 15844, 15842
OPEN, OPEN_OR_CREATE, CREATE_OR_REPLACE, CREATE = 10437, 15846, 15847, 15848


@dataclass(frozen=True)
class LogSettings:
    """What a client asks to be logged: mode, path, group and operation, by the driver's numbers."""

    mode: int = OFF
    path: str = ""
    group: str = ""
    operation: int = CREATE


class TdmsLog:
    """One open file; each block of samples is a segment of its own.

    Parameters
    ----------
    path : str
        As the client gave it; relative to the server's folder.
    operation : int
        Whether the file must exist, may, or is replaced.
    group : str
        Name of the group of channels.
    names : list of str
        Names of the channels.
    interval_s : float
        Time between two samples, s; 0 where it is not known.

    Raises
    ------
    DaqStatusError
        When npTDMS is missing, or the file cannot be opened so.
    """

    def __init__(self, path: str, operation: int, group: str, names: list[str], interval_s: float) -> None:
        file = Path(path)
        if not file.resolve().is_relative_to(Path.cwd()):
            raise DaqStatusError(Code.FILE_PATH_INVALID, f"{path!r}: the virtual device logs into {Path.cwd()} only")
        exists = file.is_file()
        if (operation == OPEN and not exists) or (operation == CREATE and exists) or not path:
            what = "does not exist" if operation == OPEN else "exists" if exists else "no path"
            raise DaqStatusError(Code.FILE_PATH_INVALID, f"{path!r}: {what}")
        try:
            from nptdms import TdmsWriter  # start-up: an optional package, only logging needs it
        except ImportError:
            raise DaqStatusError(Code.TDMS_NOT_FOUND, "pip install 'piano-action-rig[tdms]'") from None
        self._group, self._names = group, names
        self._properties: dict[str, Any] = {"wf_start_time": datetime.now(UTC).replace(tzinfo=None)}
        if interval_s > 0:
            self._properties |= {"wf_increment": interval_s, "wf_start_offset": 0.0}
        try:
            mode = "a" if exists and operation in (OPEN, OPEN_OR_CREATE) else "w"
            self._writer: TdmsWriter = TdmsWriter(path, mode=mode)
            self._writer.open()
        except OSError as error:
            raise DaqStatusError(Code.FILE_PATH_INVALID, f"{path!r}: {error.strerror}") from None

    def write(self, values: NDArray[np.float64]) -> None:
        """Append samples, (n, channels)."""
        from nptdms import ChannelObject  # start-up: as above

        try:
            self._writer.write_segment(
                [
                    ChannelObject(self._group, name, np.ascontiguousarray(values[:, k]), properties=self._properties)
                    for k, name in enumerate(self._names)
                ]
            )
        except OSError as error:
            raise DaqStatusError(Code.GENERIC_FILE_IO, str(error.strerror)) from None
        self._properties = {}

    def close(self) -> None:
        """Close the file."""
        self._writer.close()


@dataclass(frozen=True)
class AnalogShape:
    """What is waited for: a crossing of ``level`` after ``armed_at``, or of the edges of a window.

    ``source`` names a channel of the task; an empty one is a terminal to which nothing is wired. Values are in the
    channel's units.
    """

    source: str
    rising: bool
    """Upwards, or into the window."""
    level: float
    armed_at: float
    """An upward crossing counts only after a value at or below this one: the level less the hysteresis."""
    window: tuple[float, float] | None = None
    """Bottom and top; ``level`` has no meaning then."""


@dataclass(eq=False)
class Comparator:
    """An analog shape and where the signal was: each value is shown to it once, in order."""

    shape: AnalogShape
    _armed: bool = False

    def crossings(self, value: NDArray[np.float64]) -> NDArray[np.int64]:
        """Return how many crossings have come by each of the next values (n,), counted from the first of them."""
        shape, armed = self.shape, self._armed
        passed = np.zeros(value.size, dtype=np.int64)
        if not shape.source:
            return passed
        if shape.window is not None:
            bottom, top = shape.window
            beyond = ((value >= bottom) & (value <= top)) == shape.rising
            before = ~beyond
        elif shape.rising:
            beyond, before = value >= shape.level, value <= shape.armed_at
        else:
            beyond, before = value <= shape.level, value >= shape.armed_at
        count = 0
        for k in range(value.size):
            if armed and beyond[k]:
                count, armed = count + 1, False
            elif before[k]:
                armed = True
            passed[k] = count
        self._armed = armed
        return passed


@dataclass(eq=False)
class Triggers:
    """Terminals of the triggers, relative to the device; "" for none."""

    start: str = ""
    arm_start: str = ""
    reference: str = ""
    pretrigger_samples: int = 0
    """Samples to keep from before the reference trigger."""
    analog_kinds: dict[str, str] = field(default_factory=dict)
    """What a client has set of analog triggers: kind of shape by start trigger or reference trigger."""
    analog_start: AnalogShape | None = None
    analog_reference: AnalogShape | None = None
    pause: str = ""
    pause_high: bool = True
    """Sampling pauses while this terminal is high, or low."""

    @property
    def begin(self) -> str:
        """Terminal of the trigger with which sampling begins: start trigger, or arm start trigger of a counter."""
        return self.start or self.arm_start

    @property
    def awaited(self) -> bool:
        """Whether sampling begins with a trigger."""
        return bool(self.begin or self.analog_start)

    @property
    def referenced(self) -> bool:
        """Whether samples from before a trigger are kept."""
        return bool(self.reference or self.analog_reference)


class InputBuffer:
    """Input buffer of a task: a fixed size, samples acquired, samples read."""

    def __init__(self, size: int, columns: int, *, drops_oldest: bool = False) -> None:
        self.size = size
        self.drops_oldest = drops_oldest
        """Whether a full buffer drops its oldest samples instead of overflowing, as before a reference trigger."""
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
            if self.drops_oldest:
                self.take(self.available - self.size)
            else:
                self.overwritten = True

    def take(self, n: int) -> NDArray[np.float64]:
        """Remove and return the oldest n samples, shape (n, columns)."""
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
    """Shape (n, channels or lines); None before the first write."""
    generated: int = 0
    """Samples per channel generated since the start."""
    size: int = 0
    """Samples per channel the buffer holds while the task runs."""

    @property
    def written(self) -> int:
        """Samples per channel written."""
        return 0 if self.samples is None else self.samples.shape[0]


TaskType = Literal["AI", "AO", "CI", "CO", "DI", "DO"]
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


@dataclass(frozen=True)
class Timing:
    """What times the samples: a sample clock, pulses (implicit), changes of lines; on demand without a clock."""

    clock: SampleClock | None = None
    implicit: bool = False
    """The pulses a counter measures are its sample clock."""
    change_lines: frozenset[tuple[str, bool]] = frozenset()
    """Lines whose changes to these levels are the sample clock."""

    @property
    def finite(self) -> bool:
        """Whether a set number of samples is acquired or generated."""
        return self.clock is not None and self.clock.mode == daqmx.FINITE

    @property
    def own_clock(self) -> bool:
        """Whether the task makes its sample clock itself."""
        return self.clock is not None and not self.clock.source and not self.change_lines and not self.implicit


@dataclass(eq=False)
class Progress:
    """Where a task is since its start; edges and ticks are counted as the driver's counters would."""

    live: bool = False
    """Running, and its trigger has come."""
    error: int = 0
    """Status that ended a generation."""
    live_since_s: float = 0.0
    """Bench time at which it became live, s."""
    first_tick: int = 0
    """Tick of its clock at which it became live."""
    initial_edges: int = 0
    """Edges that had passed on a counter's terminal, or its encoder's count, when it became live."""
    trigger_edges: int = 0
    """Edges that had passed on the trigger's terminal when the task began to wait for it."""
    samples_before_trigger: int = 0
    """Samples acquired or generated before the last trigger, by a retriggerable task."""
    reference_edges: int | None = None
    """Edges that had passed on the reference trigger's terminal when the pretrigger samples were complete."""
    reference_end: int | None = None
    """Samples acquired by the end of the acquisition, once the reference trigger has come."""
    comparator: Comparator | None = None
    """What the running task compares its first channel with."""
    crossings: int = 0
    """Crossings it has seen."""
    runs: int = 0
    """How often it was started."""
    completed: int = 0
    """Runs that came to their own end, by all samples or an error, and were stopped since."""
    triggered: bool = False
    """The analog start trigger has come."""


@dataclass(eq=False)
class PulseGeneration:
    """Pulses a counter output generates."""

    count: int | None = 1
    """None: without end."""
    high_times_s: NDArray[np.float64] | None = None
    """High times of the pulses written, one a pulse, repeated; None when all are the channel's."""
    written: NDArray[np.float64] | None = None
    """High and low times, s, (n, 2), of the samples that a sample clock loads; None without one."""
    loaded: int = 0
    """Number of the sample loaded last."""
    passed: int = 0
    next_s: float | None = None
    """Pulses generated, and when the next one came, as pulses were written to the running output; None before."""
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
    timing: Timing = field(default_factory=Timing)
    triggers: Triggers = field(default_factory=Triggers)
    unsimulated: dict[str, str] = field(default_factory=dict)
    """Settings that the virtual device cannot act on: the task is refused when it is committed."""
    exported: set[str] = field(default_factory=set)
    """Terminals it exports its signals to, relative to the device."""
    logging: LogSettings = field(default_factory=LogSettings)
    log: TdmsLog | None = None
    """Open while a task that logs runs."""
    state: TaskState = "unreserved"
    committed: bool = False
    """Whether a client has committed it, so that it keeps its resources when it stops."""
    progress: Progress = field(default_factory=Progress)
    buffer: InputBuffer | None = None
    output: OutputBuffer = field(default_factory=OutputBuffer)
    pulses: PulseGeneration = field(default_factory=PulseGeneration)

    def add_channel(self, kind: TaskType, channel: Channel) -> None:
        """Add a channel; refuses a mixture of types and a second counter."""
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

    def forget_trigger(self, which: str) -> None:
        """Take the start trigger or reference trigger away, of whatever kind."""
        self.unsimulated.pop(which, None)
        self.triggers.analog_kinds.pop(which, None)
        setattr(self.triggers, which.removesuffix(" trigger"), "")

    def refuse_while_running(self) -> None:
        """Raise the driver's status for what cannot be done to a running task."""
        if self.state == "running":
            raise DaqStatusError(Code.CAN_NOT_PERFORM_OP_WHILE_TASK_RUNNING, f"Task: {self.name}")

    def setting(self, category: str, channel: str, number: int, default: Any) -> Any:
        """Return a property that was set, or ``default``."""
        return self.properties.get((category, channel, number), default)

    @property
    def lines(self) -> list[str]:
        """Full names of the digital lines of all channels, in order."""
        return [line for channel in self.channels for line in channel.settings["lines"]]

    @property
    def measures(self) -> str | None:
        """What a counter input measures; None for encoders and other types."""
        return self.channels[0].settings.get("measures") if self.type == "CI" else None

    @property
    def input_buffer_size(self) -> int:
        """Samples per channel the input buffer has room for: what the client set, else what the driver chooses."""
        clock = self.timing.clock
        if size := int(self.setting("Buffer", "", daqmx.BUF_INPUT_BUF_SIZE, 0)):
            return size
        if clock is None or (self.timing.finite and not self.retriggerable):
            return clock.samples if clock else 1
        # NI-DAQmx Help, "How is buffer size determined?": at least 1 kS, 10 kS, 100 kS, 1 MS by rate
        floor = 1_000 if clock.rate_hz <= 100 else 10_000 if clock.rate_hz <= 10_000 else 100_000
        return max(clock.samples, floor if clock.rate_hz <= 1e6 else 1_000_000)

    @property
    def read_all_samples(self) -> int:
        """Samples per channel a read of all available ones returns: for a finite task, all it will acquire."""
        if self.timing.clock is None or self.buffer is None:
            return 1
        referenced = self.triggers.referenced
        if not self.timing.finite or self.retriggerable or (referenced and self.samples_remaining <= 0):
            return self.buffer.available
        return self.timing.clock.samples - (0 if referenced else self.buffer.read)

    @property
    def total_samples(self) -> int:
        """Samples per channel acquired or generated since the start."""
        return self.buffer.acquired if self.buffer is not None else self.output.generated

    @property
    def samples_since_trigger(self) -> int:
        """Samples per channel acquired or generated since the last trigger."""
        return self.total_samples - self.progress.samples_before_trigger

    @property
    def samples_remaining(self) -> float:
        """Samples a finite task will still acquire or generate; infinite when it is continuous."""
        end = self.progress.reference_end
        if self.timing.clock is None or not self.timing.finite or (self.triggers.referenced and end is None):
            return float("inf")
        return end - self.total_samples if end is not None else self.timing.clock.samples - self.samples_since_trigger

    def generate(self, n: int) -> NDArray[np.float64]:
        """Return the next samples of a generation, at most n, shape (m, channels); fewer when it ends.

        A generation longer than the buffer repeats the buffer, as the driver's regeneration does; where regeneration
        is not allowed it ends with an error when the written samples are used up.
        """
        output = self.output
        if output.samples is None or self.timing.clock is None:
            return np.empty((0, len(self.channels)))
        total = self.timing.clock.samples if self.timing.finite else np.iinfo(np.int64).max
        m = int(min(n, total - self.samples_since_trigger))
        if not self.regenerates and output.generated + m > output.written:
            m = output.written - output.generated
            self.progress.error, self.progress.live = Code.GEN_STOPPED_TO_PREVENT_REGEN_OF_OLD_SAMPLES, False
        rows = (output.generated + np.arange(m)) % output.written
        output.generated += m
        return output.samples[rows]

    @property
    def retriggerable(self) -> bool:
        """Whether a finite task begins again with each edge of its start trigger."""
        return bool(self.triggers.start and self.setting("Trig", "", daqmx.START_TRIG_RETRIGGERABLE, False))

    @property
    def regenerates(self) -> bool:
        """Whether written samples may be generated again."""
        mode = self.setting("Write", "", daqmx.WRITE_REGEN_MODE, daqmx.ALLOW_REGENERATION)
        return bool(mode != daqmx.DO_NOT_ALLOW_REGENERATION)

    @property
    def ended(self) -> bool:
        """Whether the task runs and has come to its end by itself: all samples, all pulses, or an error."""
        if self.state != "running" or self.retriggerable:
            return False
        if self.type == "CO":
            return self.pulses.finished
        return bool(self.progress.error) or (self.timing.clock is not None and self.samples_remaining <= 0)

    @property
    def done(self) -> bool:
        """Whether a finite task has acquired or generated all its samples, or the task does not run."""
        if self.state != "running":
            return True
        if self.retriggerable:
            return False
        if self.timing.clock is None and self.type in ("AI", "AO", "DI", "DO"):
            return True  # on demand there is nothing to wait for
        return self.pulses.finished if self.type == "CO" else self.samples_remaining <= 0
