"""Status codes of NI-DAQmx that the virtual device can answer with, and the exceptions by which it refuses.

Names and numbers are those of the driver (``DAQmxErrors`` of nidaqmx 1.7); the texts are ours.
"""

from __future__ import annotations

TEXTS: dict[int, str] = {}


def _status(code: int, text: str) -> int:
    TEXTS[code] = text
    return code


SAMPLES_NOT_YET_AVAILABLE = _status(-200284, "Some or all of the samples requested have not yet been acquired.")
SAMPLES_NO_LONGER_AVAILABLE = _status(-200279, "The samples requested were overwritten before they were read.")
GENERATION_STOPPED = _status(-200290, "The generation stopped because no new samples were written in time.")
RESOURCE_RESERVED = _status(-50103, "The specified resource is reserved by another task.")
NOT_YET_WRITTEN = _status(-200292, "Some or all of the samples could not yet be written: the output buffer is full.")
INVALID_DEVICE = _status(-200220, "Device identifier is invalid.")
NO_SUCH_CHANNEL = _status(-200170, "Physical channel specified does not exist on this device.")
WRONG_MEASUREMENT_TYPE = _status(-200431, "The physical channel does not support the requested measurement type.")
WRONG_OUTPUT_TYPE = _status(-200432, "The physical channel does not support the requested output type.")
INVALID_VALUE = _status(-200077, "Requested value is not a supported value for this property.")
INVALID_AO_DATA = _status(-200561, "A sample to write is outside the range of the analog output channel.")
ONE_COUNTER_PER_TASK = _status(-200147, "A task can contain only one counter input channel.")
NO_SUCH_TERMINAL = _status(-89120, "Source terminal to be routed could not be found on the device.")
NO_ROUTE = _status(-89136, "The route between these terminals is not supported by the device.")
NO_TRIGGER_LINES = _status(
    -89125, "No registered trigger lines could be found between the devices in the route; register the RTSI cable."
)
ROUTE_IN_USE = _status(-89137, "The terminal carries another signal already.")
LINE_DIRECTION_CONFLICT = _status(
    -201133, "Lines of one group of the module are inputs or outputs together, not mixed."
)
NO_DATA_WRITTEN = _status(-200462, "Generation cannot be started: no samples have been written.")
TASK_RUNNING = _status(-200479, "The operation cannot be performed while the task is running.")
NOT_STARTED = _status(
    -200846, "Cannot write to a task that is not started when auto start is false and it is on demand."
)
PAST_THE_END = _status(-200278, "The read is past the last sample of a finite acquisition.")
DUPLICATE_TASK = _status(-200089, "A task of that name exists already.")
NO_SUCH_GLOBAL_CHANNEL = _status(-200882, "Global channel specified does not exist.")
NO_SAVED_TASK = _status(-200485, "Task specified is not saved on this system.")
NO_SUCH_TARGET = _status(-89121, "Destination terminal to be routed could not be found on the device.")
TRIGGER_ON_DEMAND = _status(-200262, "A trigger is set, but the samples are taken on demand.")
NO_ANALOG_TRIGGER = _status(-200214, "The device has no analog trigger circuit.")
NOT_FIRST_IN_SCAN_LIST = _status(-200131, "The source of an analog trigger must be the first channel of the task.")
INVALID_ANALOG_SOURCE = _status(-200265, "The source of an analog trigger is no terminal or channel for it.")
REFERENCE_AND_PAUSE = _status(-200628, "A reference and a pause trigger cannot be in one task.")
BUILT_IN_COLD_JUNCTION = _status(
    -200576, "The device has no built-in cold junction sensor; give a constant temperature or a channel."
)
LOGGING_OF_OUTPUTS = _status(-201332, "Samples of an output task cannot be logged.")
LOGGING_WITHOUT_BUFFER = _status(-201299, "Samples taken on demand cannot be logged.")
LOGGING_ONLY = _status(-201301, "Samples cannot be read: the task only logs them.")
NOT_FOR_LOGGING = _status(-201307, "Samples of this measurement cannot be logged.")
FILE_PATH_INVALID = _status(-201304, "The path of the log file is invalid.")
TDMS_NOT_FOUND = _status(-201310, "The TDMS library is not installed.")
GENERIC_FILE_IO = _status(-201309, "The log file cannot be written.")
CLOCK_SOURCE_REQUIRED = _status(-200303, "External sample clock source must be specified for this measurement.")
INVALID_TASK = _status(-200088, "Task is invalid or does not exist.")
NO_CHANNELS = _status(-200478, "The task has no channels.")
NO_SUCH_SCALE = _status(-200378, "Custom scale specified does not exist.")
NOT_OF_THIS_SCALE = _status(-200601, "The property is not one of this type of scale.")
ZERO_SLOPE = _status(-200409, "The slope of a linear scale must not be zero.")
PRESCALED_EQUAL = _status(-200602, "Minimum and maximum of the pre-scaled values are equal.")
SCALED_EQUAL = _status(-200603, "Minimum and maximum of the scaled values are equal.")
ZERO_FORWARD = _status(-200407, "The forward coefficients of a polynomial scale are all zero.")
ZERO_REVERSE = _status(-200408, "The reverse coefficients of a polynomial scale are all zero.")
TABLE_SIZES = _status(-200350, "A table scale has as many scaled as pre-scaled values.")
TABLE_TOO_SHORT = _status(-200434, "A table scale has at least two values.")
PRESCALED_REPEATED = _status(-200598, "Pre-scaled values of a table scale repeat.")
SCALED_REPEATED = _status(-200599, "Scaled values of a table scale repeat.")
UNITS_NOT_SCALED = _status(-200447, "A custom scale is named, but the units are not from a custom scale.")
WRONG_SIZE = _status(-200524, "The number of values does not fit channels and samples of the task.")
READ_BUFFER_TOO_SMALL = _status(-200229, "The array to read into is too small for the samples asked for.")
MIN_NOT_LESS_THAN_MAX = _status(-200082, "The minimum must be less than the maximum.")
ATTRIBUTE_NOT_SUPPORTED = _status(-200452, "The property is not supported by the virtual device for this task.")
RATE_TOO_HIGH = _status(-200332, "The sample clock rate exceeds what the device supports.")
TASK_MIXES_TYPES = _status(-200559, "Channels of different types cannot be in one task.")
OPERATION_TIMED_OUT = _status(-200474, "The operation did not complete within the time allowed.")
DEVICE_LOST = _status(-201003, "The device cannot be reached.")
WATCHDOG_NOT_SUPPORTED = _status(-200662, "The device has no watchdog timer for this output.")
WATCHDOG_TIMEOUT_OUT_OF_RANGE = _status(-200668, "The timeout of the watchdog timer is out of range.")
WATCHDOG_WHILE_OTHERS_RESERVED = _status(-201477, "A watchdog task cannot be reserved while other tasks are.")
CANNOT_RESET_EXPIRED_WATCHDOG = _status(-200644, "The watchdog timer has expired and must be cleared, not reset.")
WRITE_AFTER_WATCHDOG = _status(-200678, "The output cannot be written: the watchdog timer has expired.")
DEVICE_WATCHDOG_EXPIRED = _status(
    -201478, "The watchdog timer of the chassis has expired; nothing can be done until the chassis is reset."
)
NOT_A_WATCHDOG = _status(-200635, "The task is not a watchdog timer task.")
EVENT_WHILE_RUNNING = _status(-200960, "Events are registered before the task is started.")
NO_ACQUIRED_EVENT = _status(-200981, "Samples acquired into the buffer are no event of this task.")
NO_TRANSFERRED_EVENT = _status(-200980, "Samples transferred from the buffer are no event of this task.")
NOT_WHILE_UNRESERVED = _status(-200983, "The property can be asked only while the task is reserved, committed or runs.")
TRANSFERRED_EVENT_REGISTERED = _status(-200967, "The event is registered for this task already.")
EVENT_REGISTERED = {
    call: _status(code, "The event is registered for this task already.")
    for call, code in (
        ("RegisterEveryNSamplesEvent", -200966), ("RegisterDoneEvent", -200950), ("RegisterSignalEvent", -200949),
    )
}  # fmt: skip


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


class NotImplementedByDevice(DaqStatusError):
    """What DAQmx has and the virtual device has not: refused with the driver's code, never answered with a value."""

    def __init__(self, what: str, code: int = ATTRIBUTE_NOT_SUPPORTED) -> None:
        super().__init__(code, f"not simulated: {what}")


def one_of(value: int | float, allowed: tuple[int | float, ...], what: str) -> None:
    """Refuse a value that a setting does not have."""
    if value not in allowed:
        raise DaqStatusError(INVALID_VALUE, f"{what}: {value}, allowed {', '.join(map(str, allowed))}")
