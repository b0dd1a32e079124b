"""Channels as another program wrote them, their units, and how their sample times are known.

Conventions: values and units as in the file, nothing converted. A file may have more channels than are used, also at
other rates; those that are used must be finite and complete, and channels used together must share one clock. A unit
that is not known here contradicts any other: kgf is not N, although both are forces.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime, timedelta

import numpy as np
from numpy.typing import NDArray

from rig.arrays import as_numbers
from rig.errors import RigInputError
from rig.foreign.sample_times import (
    JITTER,
    SAMPLE_NAMES,
    SECONDS,
    TIME_NAMES,
    UNEVEN_SHARE,
    Clock,
    check_times,
    even_interval,
    find_breaks,
    is_mostly_even,
)

SYNONYMS = {
    "n": "N", "newton": "N", "newtons": "N", "mn": "mN", "millinewton": "mN", "millinewtons": "mN", "kn": "kN",
    "kilonewton": "kN", "kilonewtons": "kN",
    "dan": "daN", "dyn": "dyn", "kp": "kp", "ozf": "ozf", "lbf": "lbf", "pound-force": "lbf", "kgf": "kgf", "gf": "gf",
    "v": "V", "volt": "V", "volts": "V", "mv": "mV", "mv/v": "mV/V", "kg": "kg", "g": "g", "lb": "lb", "lbs": "lb",
    "deg": "deg", "degree": "deg", "degrees": "deg", "°": "deg", "rad": "rad", "radian": "rad", "radians": "rad",
    "mrad": "mrad", "rev": "rev", "count": "counts", "counts": "counts", "tick": "counts", "ticks": "counts",
    "s": "s", "sec": "s", "second": "s", "seconds": "s", "ms": "ms", "millisecond": "ms", "milliseconds": "ms",
    "us": "us", "µs": "us", "μs": "us", "microsecond": "us", "microseconds": "us", "ns": "ns", "nanoseconds": "ns",
    "hz": "Hz", "°c": "°C", "a": "A", "mm": "mm", "m": "m",
}  # fmt: skip
SILENT = ("", "-", "1", "none", "default si unit")
"""Texts in the place of a unit that state none."""
_UNIT_IN_NAME = re.compile(
    r".*\S(\s*[(\[](?P<bracket>[^()\[\]]*)[)\]]|(\s*/\s+|\s+/\s*|\s+in\s+)(?P<word>\S+)"
    r"|[_/](?P<tail>N|V|(?i:mn|kn|dan|kp|lbf|kgf|gf|mv|deg|rad|mrad|counts|ticks|ms|us|µs|ns)))"
)
"""Places of a unit in a name; after ``_`` or ``/`` without a space only what is no word that names a channel."""


def known_unit(text: str) -> str | None:
    """Return the unit a text states: ours for a known spelling, else the text itself; None where none is stated."""
    stated = text.partition(" since ")[0].strip()  # "seconds since 1970-01-01" of CF are seconds
    return None if stated.lower() in SILENT else SYNONYMS.get(stated.lower(), stated)


def unit_in_name(name: str) -> str:
    """Return the unit at the end of a channel's name, as written there, if it is a known one: ``Force (kN)``, ``F /
    kN``, ``F in kN``, ``force_kN``; empty where there is none."""
    found = _UNIT_IN_NAME.fullmatch(name.strip())
    if found is None:
        return ""
    unit = (found["bracket"] or found["word"] or found["tail"] or "").strip()
    return unit if unit.lower() in SYNONYMS else ""


def is_units_row(cells: list[str], decimal: str = ".") -> bool:
    """Whether a row below the names states units: one known unit at least, and no cell that could be a value."""
    bare = [cell.strip().strip("()[]").strip().lower() for cell in cells]
    return any(cell in SYNONYMS for cell in bare) and not any(_is_value(cell, decimal) for cell in bare)


def _is_value(cell: str, decimal: str) -> bool:
    """Whether a cell without a known unit is a number, a time of day, or what programs write for a missing number."""
    try:
        float(cell.replace(decimal, "."))
    except ValueError:
        return ":" in cell
    return cell not in SILENT


_TIME_WORDS = re.compile(r"time|zeit|temps|tiempo|tempo|tijd|stamp|clock", re.IGNORECASE)
_GROUPED = r"[+-]?[1-9]\d{0,2}(%s\d{3})+(?![\d%s])"
_NUMBER = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d{1,4})?", re.ASCII)
_PLAIN = frozenset("0123456789+-.eE ")
_ALIKE = {" ": "\u00a0\u202f\u2009", "'": "\u2019"}
"""Signs between thousands that also stand for the one a mapping names: no-break and thin spaces, an apostrophe."""


def parse_number(cell: str, decimal: str = ".", thousands: str = "") -> float:
    """Read a decimal number with the sign ``decimal``; ``thousands``: sign between groups of three digits, empty for
    none. ValueError for anything else, also for nan, inf, hexadecimal and 1_000.

    Groups of three digits must be whole.
    """
    text = cell.strip().replace("\u2212", "-")  # the minus sign of Swedish and typeset numbers
    for alike in _ALIKE.get(thousands, ""):
        text = text.replace(alike, thousands)
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


def parse_numbers(cells: Sequence[str], decimal: str = ".", thousands: str = "") -> NDArray[np.float64]:
    """Read decimal numbers (n,) from a column's cells (signs as in `parse_number`); ``ValueError(i, cell)`` for the
    first cell, counted from 0, that is none."""
    signs = set().union(*cells)
    if not thousands and signs <= _PLAIN | {decimal} and (decimal == "." or "." not in signs):
        try:
            values = np.array([float(cell if decimal == "." else cell.replace(decimal, ".")) for cell in cells])
        except ValueError:
            values = np.array([np.nan])
        if np.isfinite(values).all():
            return values
    values = np.empty(len(cells))
    for i, cell in enumerate(cells):
        try:
            values[i] = parse_number(cell, decimal, thousands)
        except ValueError:
            raise ValueError(i, cell) from None
    return values


def shorten_cell(cell: str) -> str:
    return repr(cell if len(cell) <= 40 else cell[:37] + "...")  # half a line


@dataclass(frozen=True, eq=False)
class ChannelTable:
    """The channels of a file, or of one segment of it.

    Attributes
    ----------
    where : str
        The file, for messages.
    channels : mapping of name to ndarray, shape (n,)
        Lengths may differ from channel to channel.
    units : mapping of name to unit text, where the file gives one, or the channel's name holds one
    clocks : mapping of name to Clock, where the file gives one
    unreadable : mapping of name to what is wrong with that channel
        Refused when it is used.
    doubts : mapping of name to what the file states of a channel and is not known here, as a scale
        Refused when the channel is used, unless a mapping overrules the file.
    computed : tuple of str
        Channels of times that follow from the stated clock, not recorded.
    cut_off : str
        Why the recording is not whole; empty where it is.
    started : str
        When the recording began, by the file itself, ISO 8601: with a zone where the file knows it; empty where it does
        not say.
    """

    where: str
    channels: Mapping[str, NDArray[np.float64]]
    units: Mapping[str, str] = field(default_factory=dict)
    clocks: Mapping[str, Clock] = field(default_factory=dict)
    unreadable: Mapping[str, str] = field(default_factory=dict)
    doubts: Mapping[str, str] = field(default_factory=dict)
    computed: tuple[str, ...] = ()
    cut_off: str = ""
    started: str = ""

    def __post_init__(self) -> None:
        of_names = {name: unit for name in self.channels if (unit := unit_in_name(name))}
        object.__setattr__(self, "units", of_names | dict(self.units))

    def channel(self, name: str) -> NDArray[np.float64]:
        """Return the values (n,) of a channel, in the file's unit; RigInputError when it is missing, unreadable, in
        doubt (an unknown scale), or holds a value that is not finite."""
        if name in self.unreadable or name in self.doubts:
            raise RigInputError(f"{self.where}: {self.unreadable.get(name) or self.doubts[name]}")
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
        """Return the one sample interval, s, of channels used together, from the channel of times or, for None, the
        file's own statement; RigInputError where lengths or clocks differ, times are uneven, or nothing tells it.

        Parameters
        ----------
        names : the channels; they must be of one length and, where the file states clocks, on one of them
        time_channel : channel of even times; None takes the file's own statement
        where_else : other source of the interval, for the message
        unit : of the channel of times: s, ms or us
        same_start : the channels begin together, whatever starts the file states

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
        """Refuse channels of different lengths, sample intervals or starts: their samples k would not belong together;
        ``same_start``: the starts that the file states are not compared."""
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

    def overrule(self, names: Collection[str], ignored: Collection[str]) -> ChannelTable:
        """Return the table with the values of ``names`` as they are, and without clocks of ``ignored`` properties."""
        return replace(
            self,
            doubts={name: doubt for name, doubt in self.doubts.items() if name not in names},
            clocks={name: clock for name, clock in self.clocks.items() if clock.source not in ignored},
        )

    def time_columns(
        self, names: Sequence[str], interval_s: float, ignored: Collection[str]
    ) -> dict[str, NDArray[np.float64]]:
        """Columns of the file, by name, that look like times of the samples of the channels ``names``, taken every
        ``interval_s``: converted to s, (n,); those in ``ignored`` are left out. They need not agree with that interval.

        A column is one by its name, or by its unit where it rises about as samples every ``interval_s`` do. A column of
        another unit or none that rises evenly, as a number of the sample does, is one by its name or as the first.
        """
        size = self.channel(names[0]).size
        group = names[0].rpartition("/")[0]
        found = {}
        for k, (path, values) in enumerate(self.channels.items()):
            name = path.rpartition("/")[2]
            if path in (*names, *ignored, *self.computed) or values.size != size or size < 2:
                continue
            of_own_group = f"{group}/{name}"
            if not np.isfinite(values).all() or (of_own_group in self.channels and path != of_own_group):
                continue
            named = TIME_NAMES.fullmatch(name) or TIME_NAMES.fullmatch(path)
            unit = known_unit(self.units.get(path, "")) or (named and (named["unit"] or "s"))
            step = float(np.median(np.diff(values)))
            if unit in SECONDS:
                if named or abs(step * SECONDS[unit] - interval_s) < UNEVEN_SHARE * interval_s:
                    found[path] = values * SECONDS[unit]
            elif interval_s > 0 and (k == 0 or SAMPLE_NAMES.search(name)) and is_mostly_even(values):
                found[path] = values * (interval_s / step)
        return found

    def check_rate(self, names: Sequence[str], interval_s: float, ignored: Collection[str] = ()) -> None:
        """Refuse the sample interval ``interval_s`` of the channels ``names`` where the file's own clock or a column of
        its times contradicts it; properties and columns in ``ignored`` are not compared."""
        stated = self.stated_clock(names)
        if stated is not None and not stated.agrees(interval_s):
            raise RigInputError(
                f"{self.where}: sample interval {stated.interval_s:g} s by the file itself, the mapping or a column of "
                f"times says {interval_s:g} s"
                + (f'; time.ignore = ["{stated.source}"] in the mapping where the file is wrong' * bool(stated.source))
            )
        for name, time_s in self.time_columns(names, interval_s, ignored).items():
            check_times(time_s, interval_s, f"{self.where}: {name}")
        for name, reason in self.unreadable.items():
            if name not in ignored and (TIME_NAMES.fullmatch(name) or _TIME_WORDS.search(name)):
                raise RigInputError(
                    f"{self.where}: {reason}; times that cannot be compared with the rate are named in time.ignore of "
                    "the mapping"
                )

    def split_at_breaks(self, time_s: NDArray[np.float64], interval_s: float) -> list[ChannelTable]:
        """Return the pieces of the table between the samples whose times (n,), s, do not follow by ``interval_s``;
        itself where there is no break; channels of other lengths than the times are left out."""
        time_s = as_numbers(time_s, "times", 1)
        at = [0, *find_breaks(time_s, interval_s), time_s.size]
        if len(at) == 2:
            return [self]
        pieces = []
        for k, (first, end) in enumerate(zip(at, at[1:], strict=False), 1):
            later_s = float(time_s[first] - time_s[0])
            started = self.started and (datetime.fromisoformat(self.started) + timedelta(seconds=later_s)).isoformat()
            pieces.append(
                replace(
                    self,
                    where=f"{self.where} piece {k}",
                    channels={name: v[first:end] for name, v in self.channels.items() if v.size == time_s.size},
                    clocks={name: c._replace(start_s=c.start_s + later_s) for name, c in self.clocks.items()},
                    cut_off=f"piece {k} of {len(at) - 1}: the times of the recording break there",
                    started=started,
                )
            )
        return pieces

    cut = split_at_breaks  # its former name, for one release
