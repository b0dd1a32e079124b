"""Status codes of NI-DAQmx that the virtual device can answer with, and the exception that carries one.

Names and numbers are those of the driver (``DAQmxErrors`` of nidaqmx 1.7); the texts are ours.
"""

from __future__ import annotations

SAMPLES_NOT_YET_AVAILABLE = -200284
SAMPLES_NO_LONGER_AVAILABLE = -200279
GENERATION_STOPPED = -200290
RESOURCE_RESERVED = -50103
NOT_YET_WRITTEN = -200292
INVALID_DEVICE = -200220
NO_SUCH_CHANNEL = -200170
WRONG_MEASUREMENT_TYPE = -200431
WRONG_OUTPUT_TYPE = -200432
INVALID_VALUE = -200077
INVALID_AO_DATA = -200561
ONE_COUNTER_PER_TASK = -200147
NO_SUCH_TERMINAL = -89120
NO_ROUTE = -89136
ROUTE_IN_USE = -89137
LINE_DIRECTION_CONFLICT = -201133
NO_DATA_WRITTEN = -200462
TASK_RUNNING = -200479
NOT_STARTED = -200846
PAST_THE_END = -200278
DUPLICATE_TASK = -200089
INVALID_TASK = -200088
NO_CHANNELS = -200478
WRONG_SIZE = -200524
READ_BUFFER_TOO_SMALL = -200229
MIN_NOT_LESS_THAN_MAX = -200082
ATTRIBUTE_NOT_SUPPORTED = -200452
RATE_TOO_HIGH = -200332
TASK_MIXES_TYPES = -200559
OPERATION_TIMED_OUT = -200474
DEVICE_LOST = -201003
WATCHDOG_NOT_SUPPORTED = -200662
WATCHDOG_TIMEOUT_OUT_OF_RANGE = -200668
WATCHDOG_WHILE_OTHERS_RESERVED = -201477
CANNOT_RESET_EXPIRED_WATCHDOG = -200644
WRITE_AFTER_WATCHDOG = -200678
NOT_A_WATCHDOG = -200635
EVENT_REGISTERED = {"RegisterEveryNSamplesEvent": -200966, "RegisterDoneEvent": -200950, "RegisterSignalEvent": -200949}
EVENT_WHILE_RUNNING = -200960

TEXTS = {
    SAMPLES_NOT_YET_AVAILABLE: "Some or all of the samples requested have not yet been acquired.",
    SAMPLES_NO_LONGER_AVAILABLE: "The samples requested were overwritten before they were read.",
    GENERATION_STOPPED: "The generation stopped because no new samples were written in time.",
    RESOURCE_RESERVED: "The specified resource is reserved by another task.",
    NOT_YET_WRITTEN: "Some or all of the samples could not yet be written: the output buffer is full.",
    INVALID_DEVICE: "Device identifier is invalid.",
    NO_SUCH_CHANNEL: "Physical channel specified does not exist on this device.",
    WRONG_MEASUREMENT_TYPE: "The physical channel does not support the requested measurement type.",
    WRONG_OUTPUT_TYPE: "The physical channel does not support the requested output type.",
    INVALID_VALUE: "Requested value is not a supported value for this property.",
    INVALID_AO_DATA: "A sample to write is outside the range of the analog output channel.",
    ONE_COUNTER_PER_TASK: "A task can contain only one counter input channel.",
    NO_SUCH_TERMINAL: "Source terminal to be routed could not be found on the device.",
    NO_ROUTE: "The route between these terminals is not supported by the device.",
    ROUTE_IN_USE: "The terminal carries another signal already.",
    LINE_DIRECTION_CONFLICT: "Lines of one group of the module are inputs or outputs together, not mixed.",
    NO_DATA_WRITTEN: "Generation cannot be started: no samples have been written.",
    TASK_RUNNING: "The operation cannot be performed while the task is running.",
    NOT_STARTED: "Cannot write to a task that is not started when auto start is false and it is on demand.",
    PAST_THE_END: "The read is past the last sample of a finite acquisition.",
    DUPLICATE_TASK: "A task of that name exists already.",
    INVALID_TASK: "Task is invalid or does not exist.",
    WRONG_SIZE: "The number of values does not fit channels and samples of the task.",
    READ_BUFFER_TOO_SMALL: "The array to read into is too small for the samples asked for.",
    MIN_NOT_LESS_THAN_MAX: "The minimum must be less than the maximum.",
    NO_CHANNELS: "The task has no channels.",
    ATTRIBUTE_NOT_SUPPORTED: "The property is not supported by the virtual device for this task.",
    RATE_TOO_HIGH: "The sample clock rate exceeds what the device supports.",
    TASK_MIXES_TYPES: "Channels of different types cannot be in one task.",
    WATCHDOG_NOT_SUPPORTED: "The device has no watchdog timer for this output.",
    WATCHDOG_TIMEOUT_OUT_OF_RANGE: "The timeout of the watchdog timer is out of range.",
    WATCHDOG_WHILE_OTHERS_RESERVED: "A watchdog task cannot be reserved while other tasks are.",
    CANNOT_RESET_EXPIRED_WATCHDOG: "The watchdog timer has expired and must be cleared, not reset.",
    WRITE_AFTER_WATCHDOG: "The output cannot be written: the watchdog timer has expired.",
    DEVICE_LOST: "The device cannot be reached.",
    **dict.fromkeys(EVENT_REGISTERED.values(), "The event is registered for this task already."),
    EVENT_WHILE_RUNNING: "Events are registered before the task is started.",
    NOT_A_WATCHDOG: "The task is not a watchdog timer task.",
    OPERATION_TIMED_OUT: "The operation did not complete within the time allowed.",
}


class DaqStatusError(Exception):
    """A driver status below zero; ``samples_read`` and ``samples_written`` are given when part of a call succeeded."""

    def __init__(
        self, code: int, detail: str = "", *, samples_read: int | None = None, samples_written: int | None = None
    ) -> None:
        super().__init__(" ".join(part for part in (TEXTS.get(code, ""), detail) if part))
        self.code = code
        self.samples_read = samples_read
        self.samples_written = samples_written


class SessionRefused(Exception):
    """A refusal by the server, not by the driver: the client sees the gRPC status of this name."""

    def __init__(self, code: str, detail: str) -> None:
        super().__init__(detail)
        self.code = code


class ServerGone(Exception):
    """The server is not there any more; the client sees UNAVAILABLE."""


class NotImplementedByDevice(Exception):
    """A call the virtual device does not have; the client sees UNIMPLEMENTED, never a made-up value."""


def one_of(value: int | float, allowed: tuple[int | float, ...], what: str) -> None:
    """Refuse a value that a setting does not have."""
    if value not in allowed:
        raise DaqStatusError(INVALID_VALUE, f"{what}: {value}, allowed {', '.join(map(str, allowed))}")
