"""Translation of what NI-DAQmx raises into the rig's typed faults."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Iterator

import grpc
import nidaqmx.errors

from rig.errors import (
    DeviceNotFound,
    HardwareFault,
    NotSupported,
    OutputUnderrun,
    ReadTimeout,
    ResourceBusy,
    RigError,
    SamplesLost,
    WatchdogTripped,
)

CLIENTS_OWN = -1
"""Code with which the client itself refuses arguments, e.g. an array of the wrong shape: no driver was asked."""
TRIPPED = "the watchdog has tripped: the device has made safe the outputs it reaches; the program was too slow"
_FAULT_OF_CODE: dict[int, tuple[type[HardwareFault], str]] = {
    -200279: (SamplesLost, "samples were overwritten before they were read"),
    -200222: (SamplesLost, "samples were overwritten on the device before they were read"),
    -200361: (SamplesLost, "the device's own memory overflowed"),
    -200284: (ReadTimeout, "the samples did not arrive in time"),
    -200474: (ReadTimeout, "the operation did not end in time"),
    -200290: (OutputUnderrun, "the motor command ran out of samples"),
    -200621: (OutputUnderrun, "the motor command ran out of samples"),
    -50103: (ResourceBusy, "the channel is reserved by another task or program; close it"),
    -200022: (ResourceBusy, "the channel is reserved by another task or program; close it"),
    -200587: (ResourceBusy, "the digital line is reserved by another task or program; close it"),
    -200220: (DeviceNotFound, "no such device; compare device.name of the rig file with NI MAX"),
    -201003: (DeviceNotFound, "the device cannot be reached; check power and cable"),
    -88705: (DeviceNotFound, "the device is gone; check power and cable"),
    **dict.fromkeys((-200644, -200678, -201478, -201434, -200681, -200712), (WatchdogTripped, TRIPPED)),
    -200452: (NotSupported, "the device does not have a call or setting that was needed"),
    -89125: (NotSupported, "no RTSI cable joins the devices; connect it and register it in NI MAX, or link = 'lines'"),
    -200170: (NotSupported, "no such channel; compare the rig file with the modules in the chassis"),
    -200431: (NotSupported, "the channel cannot make this measurement; check module and channel of the rig file"),
}

_FAULT_OF_STATUS: dict[grpc.StatusCode, tuple[type[HardwareFault], str]] = {
    grpc.StatusCode.UNAVAILABLE: (
        DeviceNotFound,
        "the NI gRPC Device Server does not answer ({phase}); check host and port",
    ),
    grpc.StatusCode.UNIMPLEMENTED: (NotSupported, "the server does not know a call that was needed ({phase})"),
    grpc.StatusCode.ALREADY_EXISTS: (
        ResourceBusy,
        "the server has a session of that name, of another rig or computer ({phase}); close that program, or, if it "
        "died, end all sessions with  pianorig recover --reset-server ADDRESS",
    ),
}


@contextlib.contextmanager
def translate_faults(phase: str, what: str) -> Iterator[None]:
    """Turn what the client raises in the block to a :class:`rig.errors.HardwareFault` of ``phase``, naming ``what``.

    What the client refuses by itself, without asking the driver, is an error of this program: RigError.
    """
    try:
        yield
    except nidaqmx.errors.DaqError as error:
        raise _fault_from_code(error, phase, what) from error
    except nidaqmx.errors.RpcError as error:
        raise _fault_from_status(error, phase, what) from error
    except nidaqmx.errors.DaqNotFoundError as error:
        raise DeviceNotFound(
            f"{what}: the NI-DAQmx driver is not installed here; install it, or use sim://", phase=phase
        ) from error
    except (nidaqmx.errors.Error, grpc.RpcError) as error:
        raise HardwareFault(f"{what}: {_first_words(str(error))}", phase=phase) from error


def _fault_from_code(error: nidaqmx.errors.DaqError, phase: str, what: str) -> RigError:
    """The rig's error for an error of the client; ``what`` names the task, ``phase`` what it was doing."""
    code = int(error.error_code)
    if code == CLIENTS_OWN:
        return RigError(f"{what}: the NI-DAQmx client was called wrongly during {phase}: {_first_words(str(error))}")
    kind, meaning = _FAULT_OF_CODE.get(code, (HardwareFault, _first_words(str(error))))
    message = f"{what}: {meaning} (NI-DAQmx {code} during {phase})"
    if kind is ReadTimeout:
        samples = int(getattr(error, "samps_per_chan_read", 0) or 0)
        return ReadTimeout(f"{message}; {samples} samples came", code=code, phase=phase, samples_read=samples)
    return kind(message, code=code, phase=phase)


def _fault_from_status(error: nidaqmx.errors.RpcError, phase: str, what: str) -> HardwareFault:
    for status, (kind, meaning) in _FAULT_OF_STATUS.items():
        if error.rpc_code in (status, status.value[0]):
            return kind(f"{what}: {meaning.format(phase=phase)}", phase=phase)
    return HardwareFault(f"{what}: {_first_words(str(error))} ({phase})", phase=phase)


def _first_words(text: str) -> str:
    text = " ".join(re.split(r"\n\s*(?:Task Name|Status Code|Property|Device)", text)[0].split())
    return text if len(text) <= 240 else text[:237] + "..."
