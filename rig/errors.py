"""Errors of the rig: one small hierarchy, each class with the exit code the command line gives it."""

from __future__ import annotations

from typing import TypeVar

T = TypeVar("T")


class RigError(Exception):
    """Base of every error the rig raises on purpose; by itself it means a defect (exit code 1)."""

    exit_code: int = 1


class RigInputError(RigError, ValueError):
    """A file, value or path given by the user cannot be used (exit code 2)."""

    exit_code: int = 2


InputError = RigInputError
"""Alias of :class:`RigInputError`."""


class HardwareFault(RigError):
    """The bench, its driver or an interlock stopped the run (exit code 3).

    Parameters
    ----------
    message : str
        One line for the experimenter.
    code : int or None
        Status code of the vendor's driver (for NI-DAQmx a negative number), if there is one.
    phase : str
        What was being done: ``connect``, ``permit``, ``configure``, ``arm``, ``start``, ``read``, ``write``,
        ``interlock`` or ``stop``.
    """

    exit_code: int = 3

    def __init__(self, message: str, *, code: int | None = None, phase: str = "read") -> None:
        super().__init__(message)
        self.code = code
        self.phase = phase


class ReadTimeout(HardwareFault):
    """The requested samples did not arrive in time; ``samples_read`` of them did."""

    def __init__(self, message: str, *, code: int | None = None, phase: str = "read", samples_read: int = 0) -> None:
        super().__init__(message, code=code, phase=phase)
        self.samples_read = samples_read


class SamplesLost(HardwareFault):
    """Samples were overwritten before they were read: the record would have a hole."""


class OutputUnderrun(HardwareFault):
    """The motor command ran out of samples while it was being generated."""


class ResourceBusy(HardwareFault):
    """A channel or device is reserved by another task or program."""


class DeviceNotFound(HardwareFault):
    """The driver, server or device named by the rig file does not answer."""


class NotSupported(HardwareFault):
    """The device refuses a channel, range, route, rate or call."""


class WatchdogTripped(HardwareFault):
    """The watchdog was not reset in time: the device itself has put the outputs in their safe state."""


class RecordingFault(HardwareFault):
    """The disk cannot store the acquired samples (phase ``write``)."""


class LimitExceeded(HardwareFault):
    """A measured value left the limits of the rig file (phase ``interlock``)."""


class NotPermitted(HardwareFault):
    """Nothing moves: confirmation, self-test or dry run is missing (phase ``permit``)."""

    def __init__(self, message: str) -> None:
        super().__init__(message, phase="permit")


def refuse(kind: type[Exception], *checks: tuple[object, str]) -> None:
    """Raise an exception of type ``kind`` with the message of the first pair (condition, message) whose condition is
    true; return None where none is.

    Parameters
    ----------
    kind : type of exception
    checks : (object, str)
        As many as there are: what must not be, by its truth, and the line that says so.

    Raises
    ------
    Exception
        Of that kind.

    Examples
    --------
    >>> import rig
    >>> rig.errors.refuse(ValueError, (1 > 2, "one is more than two"), (2 > 3, "two is more than three"))
    """
    for wrong, message in checks:
        if wrong:
            raise kind(message)


def is_defect(error: BaseException) -> bool:
    """Whether an error means a defect of a program (exit code 1): not bad input, a fault of the bench or disk, or an
    interrupt.

    Parameters
    ----------
    error : exception

    Returns
    -------
    bool

    Examples
    --------
    >>> import rig
    >>> rig.errors.is_defect(ZeroDivisionError()), rig.errors.is_defect(rig.errors.HardwareFault("no device"))
    (True, False)
    """
    return isinstance(error, Exception) and getattr(error, "exit_code", 1) == 1
