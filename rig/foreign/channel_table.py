"""Channels as another program wrote them, their units, and how their sample times are known.

Conventions: values and units as in the file, nothing converted. A file may have more channels than are used, also at
other rates; those that are used must be finite and complete, and channels used together must share one clock. A unit
that is not known here contradicts any other: kgf is not N, although both are forces.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.errors import RigInputError

SYNONYMS = {
    "n": "N", "newton": "N", "newtons": "N", "mn": "mN", "kn": "kN", "lbf": "lbf", "pound-force": "lbf",
    "v": "V", "volt": "V", "volts": "V", "mv": "mV", "mv/v": "mV/V", "kg": "kg", "g": "g", "lb": "lb", "lbs": "lb",
    "deg": "deg", "degree": "deg", "degrees": "deg", "°": "deg", "rad": "rad", "radian": "rad", "radians": "rad",
    "rev": "rev", "count": "counts", "counts": "counts", "tick": "counts", "ticks": "counts",
    "s": "s", "sec": "s", "second": "s", "seconds": "s", "ms": "ms", "us": "us", "µs": "us", "μs": "us",
    "kgf": "kgf", "gf": "gf", "hz": "Hz", "°c": "°C", "a": "A", "mm": "mm", "m": "m",
}  # fmt: skip
SILENT = ("", "-", "1", "none", "default si unit")
"""Texts in the place of a unit that state none."""
_TAIL = re.compile(r"^(?P<name>.*\S)\s*[(\[](?P<unit>[^()\[\]]*)[)\]]$")


def known(text: str) -> str | None:
    """Return the unit a text states: ours for a known spelling, else the text itself; None where none is stated."""
    stated = text.strip()
    return None if stated.lower() in SILENT else SYNONYMS.get(stated.lower(), stated)


def of_name(name: str) -> str:
    """Return the known unit in brackets at the end of a channel's name, ``Force (N)``; empty where there is none."""
    found = _TAIL.match(name)
    unit = found["unit"].strip() if found else ""
    return unit if unit.lower() in SYNONYMS else ""


def is_units_row(cells: list[str]) -> bool:
    """Whether a row below the names states units: every cell a known unit or silent, one at least known."""
    bare = [cell.strip().strip("()[]").strip().lower() for cell in cells]
    return any(cell in SYNONYMS for cell in bare) and all(cell in SYNONYMS or cell in SILENT for cell in bare)


_GROUPED = r"[+-]?[1-9]\d{0,2}(%s\d{3})+(?![\d%s])"
_NUMBER = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d{1,4})?", re.ASCII)
JITTER = 0.02
"""Largest deviation of a time from even spacing, relative to the spacing."""
SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6}
"""Units a channel of times may have."""


class Clock(NamedTuple):
    """Sample times of a channel as the file states them: sample k at ``start_s + k * interval_s`` after ``stamp_s``.

    ``stamp_s`` is the time of day or date it states beside, s from an origin of the file's; 0 where it states none.
    ``resolution_s`` is the decimal place the interval is written with; 0 where it is stated in binary.
    """

    interval_s: float
    start_s: float = 0.0
    stamp_s: float = 0.0
    resolution_s: float = 0.0

    def agrees(self, interval_s: float) -> bool:
        """Whether the stated interval is this one to its number of digits: 0.000021 s may be 1/48000 s."""
        return abs(self.interval_s - interval_s) <= max(0.51 * self.resolution_s, 1e-5 * interval_s)


def number(cell: str, decimal: str = ".", thousands: str = "") -> float:
    """Read a decimal number; ValueError for anything else, also for nan, inf, hexadecimal and 1_000.

    ``thousands``: sign between groups of three digits, which must be whole groups.
    """
    text = cell.strip()
    if thousands and thousands in text:
        sign = re.escape(thousands)
        grouped = re.match(_GROUPED % (sign, sign), text)
        if grouped is None or thousands in text[grouped.end() :]:
            raise ValueError(cell)
        text = text.replace(thousands, "")
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


def shown(cell: str) -> str:
    """Return a cell of text for a message, truncated if long."""
    return repr(cell if len(cell) <= 40 else cell[:37] + "...")


@dataclass(frozen=True, eq=False)
class ChannelTable:
    """The channels of a file, or of one segment of it.

    Attributes
    ----------
    where : str
        The file, for messages.
    channels : mapping of name to ndarray, shape (n,)
        Lengths may differ from channel to channel.
    units : mapping of name to unit text, where the file gives one
    clocks : mapping of name to Clock, where the file gives one
    unreadable : mapping of name to what is wrong with that channel
        Refused when it is used.
    started : str
        When the recording began, by the file itself, ISO 8601: with a zone where the file knows it; empty where it does
        not say.
    """

    where: str
    channels: Mapping[str, NDArray[np.float64]]
    units: Mapping[str, str] = field(default_factory=dict)
    clocks: Mapping[str, Clock] = field(default_factory=dict)
    unreadable: Mapping[str, str] = field(default_factory=dict)
    started: str = ""

    def channel(self, name: str) -> NDArray[np.float64]:
        """Return one channel; RigInputError when it is missing or holds a value that is not finite."""
        if name in self.unreadable:
            raise RigInputError(f"{self.where}: {self.unreadable[name]}")
        if name not in self.channels:
            there = ", ".join([*self.channels, *self.unreadable])[:400] or "none"
            raise RigInputError(f"{self.where}: no channel {name!r}; there are {there}")
        values = self.channels[name]
        if not np.all(np.isfinite(values)):
            row = int(np.argmin(np.isfinite(values))) + 1
            raise RigInputError(f"{self.where}: {name} row {row}: found {values[row - 1]}, allowed a finite number")
        return values

    def interval(
        self,
        names: Sequence[str],
        time_channel: str | None,
        where_else: str = "sample_rate_hz",
        *,
        unit: str = "s",
        same_start: bool = False,
    ) -> float:
        """Return the sample interval, s, that channels used together have.

        Parameters
        ----------
        names : sequence of str
            The channels; they must be of one length and, where the file states clocks, on one of them.
        time_channel : str or None
            Channel of even times; None takes the file's own statement.
        where_else : str
            Other source of the interval, for the message.
        unit : str
            Of the channel of times: s, ms or us.
        same_start : bool
            The channels begin together, whatever starts the file states.

        Raises
        ------
        RigInputError
            When the channels are of several clocks, times do not rise evenly, or nothing tells the interval.
        """
        self.check_together([*names, *([] if time_channel is None else [time_channel])], same_start)
        if time_channel is not None:
            return even_interval(self.channel(time_channel) * SECONDS[unit], f"{self.where}: {time_channel}")
        stated = self.stated_clock(names)
        if stated is None:
            raise RigInputError(f"{self.where}: no times; name the time channel or give {where_else}")
        return stated.interval_s

    def stated_clock(self, names: Sequence[str]) -> Clock | None:
        """Return the clock the file states for these channels; None where it states none."""
        return next((self.clocks[name] for name in names if name in self.clocks), None)

    def check_together(self, names: Sequence[str], same_start: bool = False) -> None:
        """Refuse channels of different lengths or clocks: their samples k would not belong together."""
        first = names[0]
        for name in names[1:]:
            sizes = self.channel(first).size, self.channel(name).size
            if sizes[0] != sizes[1]:
                raise RigInputError(
                    f"{self.where}: {first} has {sizes[0]} samples, {name} {sizes[1]}; allowed is one equal number"
                )
        timed = [(name, self.clocks[name]) for name in names if name in self.clocks]
        for name, clock in timed[1:]:
            one, reference = timed[0]
            apart = abs(clock.interval_s - reference.interval_s) * self.channels[one].size
            if apart > JITTER * reference.interval_s:
                raise RigInputError(
                    f"{self.where}: {one} has a sample every {reference.interval_s:g} s, {name} every "
                    f"{clock.interval_s:g} s; allowed is one interval for channels used together"
                )
            later = (clock.start_s - reference.start_s) + (clock.stamp_s - reference.stamp_s)
            if abs(later) > JITTER * reference.interval_s and not same_start:
                raise RigInputError(
                    f"{self.where}: {name} begins {later:g} s after {one}; channels used together must begin together "
                    "(time.same_start = true in the mapping where they did)"
                )


def even_interval(time_s: NDArray[np.float64], what: str) -> float:
    """Return the interval of even times, s; ``what`` names file and channel in errors.

    Text rounds times: rounding is not taken for jitter, as long as a lost sample would still show.

    Raises
    ------
    RigInputError
        Times that do not rise, are uneven, or are written too coarsely to tell.
    """
    if time_s.size < 2:
        raise RigInputError(f"{what}: {time_s.size} samples, allowed from 2")
    steps = np.diff(time_s)
    step = float(time_s[-1] - time_s[0]) / (time_s.size - 1)
    if not step > 0:
        raise RigInputError(f"{what} does not rise; times must be in s and in order")
    if steps.min() < 0:
        row = int(np.argmax(steps < 0)) + 2
        raise RigInputError(f"{what} row {row}: {time_s[row - 1]:.9g} s comes after {time_s[row - 2]:.9g} s")
    uneven = np.abs(steps - step) / step
    # residuals of the line through the ends: jitter, rounding at both, and a step that changes
    away = np.abs(time_s - (time_s[0] + step * np.arange(time_s.size))) / step
    if max(uneven.max(), away.max()) <= JITTER:
        return step
    rounding = _rounding(time_s) / step
    if rounding > 0.45 and abs(np.median(steps) - step) > 0.1 * step:
        raise RigInputError(
            f"{what} is written in steps of {rounding * step:g} s, too coarse for samples every {step:g} s; "
            "give sample_rate_hz instead"
        )
    explained = 0.0 if rounding > 0.45 else 1.01 * rounding
    most = max(JITTER, explained)
    if uneven.max() > explained + JITTER or away.max() > most:
        row = int(np.argmax(uneven)) + 2 if uneven.max() > explained + JITTER else int(np.argmax(away)) + 1
        raise RigInputError(
            f"{what} row {row}: {time_s[row - 1]:.9g} s is {max(away[row - 1], uneven.max()):.3g} intervals off even "
            "spacing; samples are missing, or the times are not the sample clock's"
        )
    return step


def _rounding(time_s: NDArray[np.float64]) -> float:
    """Decimal place the times are written with, s, at least their floating-point resolution."""
    floor = float(4 * np.spacing(np.abs(time_s).max()))
    for digits in range(1, 9):
        if 10.0**-digits < floor:
            break
        if np.all(np.abs(np.round(time_s, digits) - time_s) <= max(floor, 1e-15)):
            return float(10.0**-digits)
    return floor
