"""Steps towards the safe state: every one is tried whatever happens to the others, and every failure is logged."""

from __future__ import annotations

import logging
from collections.abc import Callable

import nidaqmx

from rig.errors import is_defect

LOG = logging.getLogger("rig.daq")


def attempt(step: Callable[[], None], failures: list[BaseException], what: str) -> bool:
    """Try one step; log a failure and append it, even a Ctrl-C, which must not prevent the next step.

    Parameters
    ----------
    step : callable
        What to do.
    failures : list
        Takes what the step raised.
    what : str
        The step in words, for the log.

    Returns
    -------
    bool
        Whether the step was done.
    """
    try:
        step()
    except BaseException as error:
        defect = is_defect(error) and not isinstance(error, nidaqmx.errors.Error)
        LOG.error("%s failed: %s: %s", what, type(error).__name__, error, exc_info=error if defect else None)
        failures.append(error)
        return False
    return True


def worst(failures: list[BaseException]) -> BaseException:
    """Return the failure to raise: a programming error before the first fault of the hardware, so that neither hides.

    A fault caused by an error in this program would otherwise be blamed on the bench.
    """
    return next(filter(is_defect, failures), failures[0])
