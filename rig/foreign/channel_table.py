"""Channels of equal length as some program wrote them, and how their times are known.

Conventions: values and units as in the file, nothing converted. All values are finite: a file with a gap, NaN or
infinity in a channel that is asked for is refused.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from rig.errors import InputError

_NUMBER = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d{1,4})?", re.ASCII)
JITTER = 0.02
"""Largest deviation of a time from even spacing, relative to the spacing."""


def number(cell: str, decimal: str = ".") -> float:
    """Read a decimal number; ValueError for anything else, also for nan, inf, hexadecimal and 1_000."""
    text = cell.strip()
    if decimal != ".":
        if "." in text:
            raise ValueError(cell)
        text = text.replace(decimal, ".")
    if not _NUMBER.fullmatch(text):
        raise ValueError(cell)
    value = float(text)
    if not np.isfinite(value):
        raise ValueError(cell)
    return value


@dataclass(frozen=True, eq=False)
class ChannelTable:
    """What a file holds.

    Attributes
    ----------
    where : str
        The file, for messages.
    channels : mapping of name to ndarray, shape (n,)
    units : mapping of name to unit text, where the file gives one
    interval_s : float or None
        Sample interval, s, where the file gives one beside its channels.
    """

    where: str
    channels: Mapping[str, NDArray[np.float64]]
    units: Mapping[str, str] = field(default_factory=dict)
    interval_s: float | None = None

    def channel(self, name: str) -> NDArray[np.float64]:
        """Return one channel; InputError when it is missing or holds a value that is not finite."""
        if name not in self.channels:
            raise InputError(f"{self.where}: no channel {name!r}; there are {', '.join(self.channels) or 'none'}")
        values = self.channels[name]
        if not np.all(np.isfinite(values)):
            row = int(np.argmin(np.isfinite(values))) + 1
            raise InputError(f"{self.where}: {name} row {row}: found {values[row - 1]}, allowed a finite number")
        return values

    def interval(self, time_channel: str | None, where_else: str = "sample_rate_hz") -> float:
        """Return the sample interval, s, from a channel of even times in s, or from the file's own statement.

        Raises
        ------
        InputError
            When times do not rise evenly, or nothing tells the interval.
        """
        if time_channel is None:
            if self.interval_s is None:
                raise InputError(f"{self.where}: no times; name the time channel or give {where_else}")
            return self.interval_s
        time_s = self.channel(time_channel)
        if time_s.size < 2:
            raise InputError(f"{self.where}: {time_s.size} samples, allowed from 2")
        step = float(time_s[-1] - time_s[0]) / (time_s.size - 1)
        if not step > 0:
            raise InputError(f"{self.where}: {time_channel} does not rise; times must be in s and in order")
        away = np.abs(time_s - (time_s[0] + step * np.arange(time_s.size))) / step
        if away.max() > max(JITTER, 0.5000001 * _rounding(time_s) / step):
            row = int(np.argmax(away)) + 1
            raise InputError(
                f"{self.where}: {time_channel} row {row}: {time_s[row - 1]:g} s is {away.max():.3g} intervals off even "
                "spacing; samples are missing, or the times are not the sample clock's"
            )
        return step


def _rounding(time_s: NDArray[np.float64]) -> float:
    """Smallest decimal place the times are written with, s, at least 1e-9: rounded text is not jitter."""
    for digits in range(1, 9):
        if np.all(np.abs(np.round(time_s, digits) - time_s) < 1e-10 * np.maximum(np.abs(time_s), 1.0)):
            return float(10.0**-digits)
    return 1e-9
