"""Status codes of NI-DAQmx that the virtual device can answer with, and the exceptions by which it refuses.

Numbers and names are those of the client (``DAQmxErrors`` of nidaqmx); the texts are ours.
"""

from __future__ import annotations

from nidaqmx.error_codes import DAQmxErrors

Code = DAQmxErrors
TEXTS: dict[int, str] = {
    Code.SAMPLES_NOT_YET_AVAILABLE: "Some or all of the samples requested have not yet been acquired.",
    Code.SAMPLES_NO_LONGER_AVAILABLE: "The samples requested were overwritten before they were read.",
    Code.GEN_STOPPED_TO_PREVENT_REGEN_OF_OLD_SAMPLES: (
        "The generation stopped because no new samples were written in time."
    ),
    Code.PAL_RESOURCE_RESERVED: "The specified resource is reserved by another task.",
    Code.SAMPLES_CAN_NOT_YET_BE_WRITTEN: (
        "Some or all of the samples could not yet be written: the output buffer is full."
    ),
    Code.INVALID_DEVICE_ID: "Device identifier is invalid.",
    Code.PHYSICAL_CHAN_DOES_NOT_EXIST: "Physical channel specified does not exist on this device.",
    Code.PHYS_CHAN_MEAS_TYPE: "The physical channel does not support the requested measurement type.",
    Code.PHYS_CHAN_OUTPUT_TYPE: "The physical channel does not support the requested output type.",
    Code.INVALID_ATTRIBUTE_VALUE: "Requested value is not a supported value for this property.",
    Code.INVALID_AO_DATA_WRITE: "A sample to write is outside the range of the analog output channel.",
    Code.MULTIPLE_COUNTER_INPUT_TASK: "A task can contain only one counter input channel.",
    Code.INVALID_ROUTING_SOURCE_TERMINAL_NAME_ROUTING: "Source terminal to be routed could not be found on the device.",
    Code.ROUTE_NOT_SUPPORTED_BY_HW_ROUTING: "The route between these terminals is not supported by the device.",
    Code.TRIG_LINE_NOT_FOUND_ROUTING: (
        "No registered trigger lines could be found between the devices in the route; register the RTSI cable."
    ),
    Code.RESOURCES_IN_USE_FOR_ROUTE_ROUTING: "The terminal carries another signal already.",
    Code.LINE_CONFLICT_CDAQ: "Lines of one group of the module are inputs or outputs together, not mixed.",
    Code.OUTPUT_BUFFER_EMPTY: "Generation cannot be started: no samples have been written.",
    Code.CAN_NOT_PERFORM_OP_WHILE_TASK_RUNNING: "The operation cannot be performed while the task is running.",
    Code.CANNOT_WRITE_WHEN_AUTO_START_FALSE_AND_TASK_NOT_RUNNING: (
        "Cannot write to a task that is not started when auto start is false and it is on demand."
    ),
    Code.SAMPLES_WILL_NEVER_BE_AVAILABLE: "The read is past the last sample of a finite acquisition.",
    Code.DUPLICATE_TASK: "A task of that name exists already.",
    Code.INVALID_GLOBAL_CHAN: "Global channel specified does not exist.",
    Code.TASK_NOT_IN_DATA_NEIGHBORHOOD: "Task specified is not saved on this system.",
    Code.INVALID_ROUTING_DESTINATION_TERMINAL_NAME_ROUTING: (
        "Destination terminal to be routed could not be found on the device."
    ),
    Code.TRIG_WHEN_ON_DEMAND_SAMP_TIMING: "A trigger is set, but the samples are taken on demand.",
    Code.NO_ANALOG_TRIG_HW: "The device has no analog trigger circuit.",
    Code.ANALOG_TRIG_CHAN_NOT_FIRST_IN_SCAN_LIST: (
        "The source of an analog trigger must be the first channel of the task."
    ),
    Code.INVALID_ANALOG_TRIG_SRC: "The source of an analog trigger is no terminal or channel for it.",
    Code.REF_AND_PAUSE_TRIG_CONFIGURED: "A reference and a pause trigger cannot be in one task.",
    Code.BUILT_IN_CJC_SRC_NOT_SUPPORTED: (
        "The device has no built-in cold junction sensor; give a constant temperature or a channel."
    ),
    Code.LOGGING_NOT_SUPPORT_ON_OUTPUT_TASKS: "Samples of an output task cannot be logged.",
    Code.LOGGING_MODE_NOT_SUPPORTED_NON_BUFFERED: "Samples taken on demand cannot be logged.",
    Code.READ_NOT_SUPPORTED_FOR_LOGGING_MODE: "Samples cannot be read: the task only logs them.",
    Code.MEASUREMENT_TYPE_NOT_SUPPORTED_FOR_LOGGING: "Samples of this measurement cannot be logged.",
    Code.FILE_PATH_INVALID: "The path of the log file is invalid.",
    Code.TDMS_NOT_FOUND: "The TDMS library is not installed.",
    Code.GENERIC_FILE_IO: "The log file cannot be written.",
    Code.EXT_SAMP_CLK_SRC_NOT_SPECIFIED: "External sample clock source must be specified for this measurement.",
    Code.INVALID_TASK: "Task is invalid or does not exist.",
    Code.CAN_NOT_PERFORM_OP_WHEN_NO_CHANS_IN_TASK: "The task has no channels.",
    Code.CUSTOM_SCALE_DOES_NOT_EXIST: "Custom scale specified does not exist.",
    Code.PROPERTY_NOT_SUPPORTED_FOR_SCALE_TYPE: "The property is not one of this type of scale.",
    Code.ZERO_SLOPE_LINEAR_SCALE: "The slope of a linear scale must not be zero.",
    Code.PRE_SCALED_MIN_EQUAL_MAX: "Minimum and maximum of the pre-scaled values are equal.",
    Code.SCALED_MIN_EQUAL_MAX: "Minimum and maximum of the scaled values are equal.",
    Code.ZERO_FORWARD_POLY_SCALE_COEFFS: "The forward coefficients of a polynomial scale are all zero.",
    Code.ZERO_REVERSE_POLY_SCALE_COEFFS: "The reverse coefficients of a polynomial scale are all zero.",
    Code.TABLE_SCALE_NUM_PRE_SCALED_AND_SCALED_VALS_NOT_EQUAL: "A table scale has as many scaled as pre-scaled values.",
    Code.FEWER_THAN_2_PRE_SCALED_VALS: "A table scale has at least two values.",
    Code.REPEATED_NUMBER_IN_PRE_SCALED_VALUES: "Pre-scaled values of a table scale repeat.",
    Code.REPEATED_NUMBER_IN_SCALED_VALUES: "Scaled values of a table scale repeat.",
    Code.UNITS_NOT_FROM_CUSTOM_SCALE: "A custom scale is named, but the units are not from a custom scale.",
    Code.WRITE_NUM_CHANS_MISMATCH: "The number of values does not fit channels and samples of the task.",
    Code.READ_BUFFER_TOO_SMALL: "The array to read into is too small for the samples asked for.",
    Code.MIN_NOT_LESS_THAN_MAX: "The minimum must be less than the maximum.",
    Code.ATTRIBUTE_NOT_SUPPORTED_IN_TASK_CONTEXT: "The property is not supported by the virtual device for this task.",
    Code.SAMP_RATE_TOO_HIGH: "The sample clock rate exceeds what the device supports.",
    Code.MULTI_CHAN_TYPES_IN_TASK: "Channels of different types cannot be in one task.",
    Code.OPERATION_TIMED_OUT: "The operation did not complete within the time allowed.",
    Code.DEV_CANNOT_BE_ACCESSED: "The device cannot be reached.",
    Code.WATCHDOG_TIMER_NOT_SUPPORTED: "The device has no watchdog timer for this output.",
    Code.WATCHDOG_TIMEOUT_OUT_OF_RANGE_AND_NOT_SPECIAL_VAL: "The timeout of the watchdog timer is out of range.",
    Code.CANT_RESERVE_WATCHDOG_TASK_WHILE_OTHER_TASKS_RESERVED: (
        "A watchdog task cannot be reserved while other tasks are."
    ),
    Code.CANT_RESET_EXPIRED_WATCHDOG: "The watchdog timer has expired and must be cleared, not reset.",
    Code.WRITE_FAILED_BECAUSE_WATCHDOG_EXPIRED: "The output cannot be written: the watchdog timer has expired.",
    Code.CHASSIS_WATCHDOG_TIMER_EXPIRED: (
        "The watchdog timer of the chassis has expired; nothing can be done until the chassis is reset."
    ),
    Code.ACTION_NOT_SUPPORTED_TASK_NOT_WATCHDOG: "The task is not a watchdog timer task.",
    Code.CANNOT_REGISTER_DA_QMX_SOFTWARE_EVENT_WHILE_TASK_IS_RUNNING: (
        "Events are registered before the task is started."
    ),
    Code.EVERY_N_SAMPLES_ACQ_INTO_BUFFER_EVENT_NOT_SUPPORTED_BY_DEVICE: (
        "Samples acquired into the buffer are no event of this task."
    ),
    Code.EVERY_N_SAMPS_TRANSFERRED_FROM_BUFFER_EVENT_NOT_SUPPORTED_BY_DEVICE: (
        "Samples transferred from the buffer are no event of this task."
    ),
    Code.CANNOT_GET_PROPERTY_WHEN_TASK_NOT_RESERVED_COMMITTED_OR_RUNNING: (
        "The property can be asked only while the task is reserved, committed or runs."
    ),
    Code.EVERY_N_SAMPS_TRANSFERRED_FROM_BUFFER_EVENT_ALREADY_REGISTERED: (
        "The event is registered for this task already."
    ),
    Code.EVERY_N_SAMPS_ACQ_INTO_BUFFER_EVENT_ALREADY_REGISTERED: "The event is registered for this task already.",
    Code.DONE_EVENT_ALREADY_REGISTERED: "The event is registered for this task already.",
    Code.SIGNAL_EVENT_ALREADY_REGISTERED: "The event is registered for this task already.",
}
EVENT_REGISTERED = {
    "RegisterEveryNSamplesEvent": Code.EVERY_N_SAMPS_ACQ_INTO_BUFFER_EVENT_ALREADY_REGISTERED,
    "RegisterDoneEvent": Code.DONE_EVENT_ALREADY_REGISTERED,
    "RegisterSignalEvent": Code.SIGNAL_EVENT_ALREADY_REGISTERED,
}
"""Status of an event that is registered twice, by its call."""


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


class Unsupported(DaqStatusError):
    """A property or call that this task, channel or product does not have."""

    def __init__(self, detail: str) -> None:
        super().__init__(Code.ATTRIBUTE_NOT_SUPPORTED_IN_TASK_CONTEXT, detail)


class NotImplementedByDevice(DaqStatusError):
    """What DAQmx has and the virtual device has not: refused with the driver's code, never answered with a value."""

    def __init__(self, what: str, code: int = Code.ATTRIBUTE_NOT_SUPPORTED_IN_TASK_CONTEXT) -> None:
        super().__init__(code, f"not simulated: {what}")


def refuse_any(*checks: tuple[object, int, str]) -> None:
    """Raise the status and detail of the first check that holds; a check begins with what must not be."""
    for wrong, code, detail in checks:
        if wrong:
            raise DaqStatusError(code, detail)


def one_of(value: int | float, allowed: tuple[int | float, ...], what: str) -> None:
    """Refuse a value that a setting does not have."""
    if value not in allowed:
        raise DaqStatusError(Code.INVALID_ATTRIBUTE_VALUE, f"{what}: {value}, allowed {', '.join(map(str, allowed))}")
