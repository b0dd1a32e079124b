"""Status codes of NI-DAQmx that the virtual device can answer with, and the exceptions by which it refuses.

Numbers and names are those of the client (``DAQmxErrors`` of nidaqmx); the texts are those names or ours.
"""

from __future__ import annotations

from nidaqmx.error_codes import DAQmxErrors

Code = DAQmxErrors
UNSUPPORTED = Code.ATTRIBUTE_NOT_SUPPORTED_IN_TASK_CONTEXT
TEXTS: dict[int, str] = {
    Code.SAMPLES_NOT_YET_AVAILABLE: "Some or all of the samples requested have not yet been acquired.",
    Code.SAMPLES_NO_LONGER_AVAILABLE: "The samples requested were overwritten before they were read.",
    Code.GEN_STOPPED_TO_PREVENT_REGEN_OF_OLD_SAMPLES: (
        "The generation stopped because no new samples were written in time."
    ),
    Code.PAL_RESOURCE_RESERVED: "The specified resource is reserved by another task.",
    Code.SAMPLES_CAN_NOT_YET_BE_WRITTEN: "Some or all of the samples could not yet be written: the buffer is full.",
    Code.INVALID_DEVICE_ID: "Device identifier is invalid.",
    Code.PHYSICAL_CHAN_DOES_NOT_EXIST: "Physical channel specified does not exist on this device.",
    Code.PHYS_CHAN_MEAS_TYPE: "The physical channel does not support the requested measurement type.",
    Code.PHYS_CHAN_OUTPUT_TYPE: "The physical channel does not support the requested output type.",
    Code.INVALID_ATTRIBUTE_VALUE: "Requested value is not a supported value for this property.",
    Code.INVALID_AO_DATA_WRITE: "A sample to write is outside the range of the analog output channel.",
    Code.TRIG_LINE_NOT_FOUND_ROUTING: (
        "No registered trigger lines could be found between the devices in the route; register the RTSI cable."
    ),
    Code.RESOURCES_IN_USE_FOR_ROUTE_ROUTING: "The terminal carries another signal already.",
    Code.LINE_CONFLICT_CDAQ: "Lines of one group of the module are inputs or outputs together, not mixed.",
    Code.OUTPUT_BUFFER_EMPTY: "Generation cannot be started: no samples have been written.",
    Code.SAMPLES_WILL_NEVER_BE_AVAILABLE: "The read is past the last sample of a finite acquisition.",
    Code.TASK_NOT_IN_DATA_NEIGHBORHOOD: "Task specified is not saved on this system.",
    Code.TRIG_WHEN_ON_DEMAND_SAMP_TIMING: "A trigger is set, but the samples are taken on demand.",
    Code.BUILT_IN_CJC_SRC_NOT_SUPPORTED: (
        "The device has no built-in cold junction sensor; give a constant temperature or a channel."
    ),
    Code.WAIT_UNTIL_DONE_DOES_NOT_INDICATE_DONE: (
        "Wait Until Done did not indicate that the task was done within the specified timeout."
    ),
    Code.TDMS_NOT_FOUND: "The TDMS library is not installed.",
    Code.UNITS_NOT_FROM_CUSTOM_SCALE: "A custom scale is named, but the units are not from a custom scale.",
    Code.WRITE_NUM_CHANS_MISMATCH: "The number of values does not fit channels and samples of the task.",
    UNSUPPORTED: "The property is not supported by the virtual device for this task.",
    Code.CHASSIS_WATCHDOG_TIMER_EXPIRED: (
        "The watchdog timer of the chassis has expired; nothing can be done until the chassis is reset."
    ),
}
"""What says more than the code's own name."""
IN_FULL = {"CANT": "cannot", "CHAN": "channel", "CHANS": "channels", "COEFFS": "coefficients", "CONV": "conversion",
           "DAQMX": "DAQmx", "DEV": "device", "HW": "hardware", "MAX": "maximum", "MIN": "minimum", "NUM": "number of",
           "POLY": "polynomial", "REF": "reference", "SAMP": "sample", "SAMPS": "samples",
           "SRC": "source", "TRIG": "trigger", "VALS": "values"}  # fmt: skip
"""Words that the names shorten."""


def text_of(code: int) -> str:
    """Return the text of a status: what there is to say, or its name in words."""
    if code in TEXTS or code not in set(Code):
        return TEXTS.get(code, "Error code could not be found.")
    names = Code(code).name.replace("DA_QMX", "DAQMX").split("_")
    words = " ".join(IN_FULL.get(word, word.lower()) for word in names)
    return words[:1].upper() + words[1:] + "."


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
        super().__init__(" ".join(filter(None, (text_of(code), detail))))
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
        super().__init__(UNSUPPORTED, detail)


class NotImplementedByDevice(DaqStatusError):
    """What DAQmx has and the virtual device has not: refused with the driver's code, never answered with a value."""

    def __init__(self, what: str, code: int = UNSUPPORTED) -> None:
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
