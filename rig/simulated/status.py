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
    Code.OUTPUT_BUFFER_EMPTY: "Generation cannot be started: no samples have been written.",
    Code.SAMPLES_WILL_NEVER_BE_AVAILABLE: "The read is past the last sample of a finite acquisition.",
    Code.WAIT_UNTIL_DONE_DOES_NOT_INDICATE_DONE: "The task was not done within the timeout.",
    Code.WRITE_NUM_CHANS_MISMATCH: "The number of values does not fit channels and samples of the task.",
    UNSUPPORTED: "Not supported by the virtual bench.",
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
    if code in TEXTS or code not in set(Code):
        return TEXTS.get(code, "Error code could not be found.")
    names = Code(code).name.replace("DA_QMX", "DAQMX").split("_")
    words = " ".join(IN_FULL.get(word, word.lower()) for word in names)
    return words[:1].upper() + words[1:] + "."


class DaqStatusError(Exception):
    """A driver status below zero; ``samples_read`` is given by a read."""

    def __init__(self, code: int, detail: str = "", *, samples_read: int | None = None) -> None:
        super().__init__(" ".join(filter(None, (text_of(code), detail))))
        self.code = code
        self.samples_read = samples_read


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


class NotAnswered(Unsupported):
    """What NI-DAQmx has and ``rig.daq`` never asks for: refused by its name, never answered with a value."""

    def __init__(self, what: str) -> None:
        super().__init__(f"{what}: rig.daq never asks for it; what is answered is listed in rig/simulated/rpc/calls.py")


def refuse_any(*checks: tuple[object, int, str]) -> None:
    """Raise the status and detail of the first check that holds; a check begins with what must not be."""
    for wrong, code, detail in checks:
        if wrong:
            raise DaqStatusError(code, detail)


def require_one_of(value: int | float, allowed: tuple[int | float, ...], what: str) -> None:
    if value not in allowed:
        raise DaqStatusError(Code.INVALID_ATTRIBUTE_VALUE, f"{what}: {value}, allowed {', '.join(map(str, allowed))}")
