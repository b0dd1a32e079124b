"""What a recording by another program holds, and a mapping for its import that a person completes."""

from __future__ import annotations

import re
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pianorig.errors import CommandInputError
from rig.atomic_write import write_text
from rig.configuration.rig_file import COUNTS_PER_REVOLUTION
from rig.configuration.toml_file import dump_toml, toml_value
from rig.errors import RigInputError
from rig.foreign.channel_table import ChannelTable, known_unit
from rig.foreign.csv_file import parse_csv, read_text
from rig.foreign.mapping import NEWTONS, parse_mapping
from rig.foreign.reading import SUFFIXES, TEXT, read_segments
from rig.foreign.sample_times import SECONDS, TIME_NAMES, typical_interval
from rig.foreign.session_import import COUNTER_BITS, has_wraps, make_trial

MOST_LINES_ABOVE = 60  # the names of the columns, that are tried; headers of data loggers take up to about 50
NAMES = {
    "force": re.compile(r".*(force|load|kraft|druck|fz|newton|\bn\b).*", re.IGNORECASE),
    "key": re.compile(r".*(key|taste|touche|tecla).*", re.IGNORECASE),
    "whippen": re.compile(r".*(whippen|wippen|hebeglied|chevalet).*", re.IGNORECASE),
    "hammer": re.compile(r".*(hammer|marteau|martello).*", re.IGNORECASE),
}
STEPS_OF_ANGLES = 2**24  # counts of a turn in which angles are stored: 0.4 microradians, finer than encoders read
FEWEST_READINGS = 16  # different ones, from which a grid is told
OFF_GRID = 0.25  # of a step, at most: numbers at random lie within it with probability 2^-n
FORCE_UNITS = (*NEWTONS, "V", "mV", "mV/V")
CHECK = "  # CHECK: "


def recording_facts(path: Path, out: Path | None = None) -> dict[str, Any]:
    """Facts of a foreign file by name: segments, a row for each channel (unit, samples, rate, range), what cannot be
    used, and the text of a proposed ``mapping``, which is written to ``out`` if named, never over a file."""
    tables, text_format = _read_tables(path)
    rows = [
        {
            "channel": name,
            "unit": table.units.get(name, "") or "not stated",
            "samples": values.size,
            "rate_hz": _rate_text(table, name),
            "from": f"{np.nanmin(values):.6g}" if np.isfinite(values).any() else "nan",
            "to": f"{np.nanmax(values):.6g}" if np.isfinite(values).any() else "nan",
            "segment": number,
        }
        for number, table in enumerate(tables, 1)
        for name, values in table.channels.items()
    ]
    unusable = {name: reason for table in tables for name, reason in {**table.unreadable, **table.doubts}.items()}
    facts: dict[str, Any] = {"file": path, "segments": len(tables), **text_format, "channels": rows}
    facts |= (
        {"unusable": [{"channel": name, "because": reason} for name, reason in unusable.items()]} if unusable else {}
    )
    cut_off = [table.cut_off for table in tables if table.cut_off]
    facts |= {"not_whole": cut_off[0]} if cut_off else {}
    proposal = _propose_mapping(tables, text_format)
    if out is not None:
        if out.exists() or "\n" not in proposal["mapping"]:
            reason = "exists already; choose another name" if out.exists() else f"not written, {proposal['mapping']}"
            raise CommandInputError(f"{out}: {reason}")
        write_text(out, proposal["mapping"])
    return facts | proposal


def is_recording(path: Path) -> bool:
    """Whether a path is a file, also one that is missing or of another kind, and no folder of a session."""
    return path.is_file() or (not path.exists() and path.name.lower().endswith(SUFFIXES))


def _read_tables(path: Path) -> tuple[tuple[ChannelTable, ...], dict[str, Any]]:
    """Tables of a foreign file, one a segment, and, where it is CSV, the settings with which it reads best (separator,
    decimal, thousands, names_row), by name; RigInputError where none does."""
    if not path.name.lower().removesuffix(".gz").endswith(TEXT):
        return read_segments(path), {}
    text = read_text(path)
    head = "\n".join(text.splitlines()[: MOST_LINES_ABOVE + 40])
    best: tuple[tuple[int, int], dict[str, Any]] | None = None
    for (separator, decimal), thousands in product(
        ((",", "."), (";", ","), (";", "."), ("\t", "."), ("\t", ","), (" ", "."), (",", ",")),
        ("", ".", ",", " ", "'"),
    ):
        if thousands == decimal or (thousands and best and best[0][1] == 0):
            continue
        for row in (None, *range(1, 1 + min(MOST_LINES_ABOVE, head.count("\n")))):
            found = {"separator": separator, "decimal": decimal, "thousands": thousands, "names_row": row}
            try:
                table = parse_csv(head, str(path), **found)
            except RigInputError:
                continue
            # most columns of numbers; then fewest that are none; the first found wins
            score = (len(table.channels), -len(table.unreadable))
            if best is None or score > best[0]:
                best = score, found
            break
    if best is None:
        raise RigInputError(
            f"{path}: no separator and line of names give columns of equal length; look at it in a text editor"
        )
    stated = best[1]
    table = parse_csv(text, str(path), **stated)
    advised = [re.search(r'thousands = "(.)"', reason) for reason in table.unreadable.values()]
    if any(advised) and not stated["thousands"]:  # groups of three digits stand below the lines that were tried
        stated["thousands"] = next(found[1] for found in advised if found)
        table = parse_csv(text, str(path), **stated)
    return (table,), {key: value for key, value in stated.items() if value}


def _rate_text(table: ChannelTable, name: str) -> str:
    """Sample rate of a channel, Hz, as text without the unit, by the file's clock or a column of times; "not stated"
    without either."""
    size = table.channels[name].size
    if name in table.clocks:
        return f"{1.0 / table.clocks[name].interval_s:.6g}"
    times = _time_column(table, name)
    if times is None or table.channels[times].size != size or size < 2:
        return "not stated"
    interval_s = typical_interval(table.channels[times]) * SECONDS.get(
        known_unit(table.units.get(times, "")) or "s", 0.0
    )
    return f"{1.0 / interval_s:.6g}" if interval_s > 0 else "not stated"


def _time_column(table: ChannelTable, beside: str) -> str | None:
    """Return the channel of times of another one's group: by its name, or the first with a unit of time."""
    group = beside.rpartition("/")[0]
    names = sorted(table.channels, key=lambda name: name.rpartition("/")[0] != group)
    of_name = [name for name in names if TIME_NAMES.fullmatch(name) or TIME_NAMES.fullmatch(name.rpartition("/")[2])]
    of_unit = [name for name in names if known_unit(table.units.get(name, "")) in SECONDS]
    return next(iter([*of_name, *of_unit]), None)


def _find_channel(table: ChannelTable, sought: str, excluded: list[str], group: str = "") -> str | None:
    """Name of the channel that is ``sought``: 'force', or key, whippen, hammer for its angle, by its unit (force), then
    by its name, not among ``excluded``; those of ``group`` come first. None if there is none.

    One that cannot be read is found as well, so that what is wrong with it is said.
    """
    names = sorted((*table.channels, *table.unreadable), key=lambda name: name.rpartition("/")[0] != group)
    units = {name: known_unit(table.units.get(name, "")) for name in names if name not in excluded}
    if sought == "force":
        found = [name for name, unit in units.items() if unit in NEWTONS]
        if found:
            return found[0]
        units = {name: unit for name, unit in units.items() if unit is None or unit in FORCE_UNITS}
    else:
        units = {name: unit for name, unit in units.items() if unit in (None, "counts", "rad", "deg")}
    return next((name for name in units if NAMES[sought].fullmatch(name)), None)


def _propose_mapping(tables: tuple[ChannelTable, ...], text_format: dict[str, Any]) -> dict[str, Any]:
    """``mapping``: text of a mapping file for the first table (begins with "none:" where no force is found), and
    ``does_not_import_yet``: why it does not import the tables, where it does not."""
    table = tables[0]
    force = _find_channel(table, "force", [*table.computed])
    time = None if force is None or table.clocks else _time_column(table, force)
    if force is None:
        return {"mapping": "none: no channel has a unit of force or a name like force, load, Kraft"}
    encoders = _find_encoders(table, [time or "", force, *table.computed], force.rpartition("/")[0])
    absent = [body for body in COUNTS_PER_REVOLUTION if body not in encoders]
    settings = {**text_format, **({"segments": "trials"} if len(tables) > 1 else {})}
    settings |= {"absent_encoders": absent} if absent else {}
    head = [
        'schema = "piano-action-rig mapping 1"',
        "simulated = false",
        f"mains_frequency_hz = 50.0{CHECK}50 or 60 Hz",
        *dump_toml(settings).splitlines(),
    ]
    body = ["", "[time]", *_time_lines(table, time), "", "[force]", *_force_lines(table, force)]
    for name, (channel, unit) in encoders.items():
        body += [
            "", "[[encoders]]",
            *(f"{key} = {toml_value(text)}" for key, text in (("name", name), ("channel", channel))),
            f"unit = {toml_value(unit)}"
            + ("" if known_unit(table.units.get(channel, "")) else f"{CHECK}the file states none"),
            *(f"counter_bits = {bits}" for bits in COUNTER_BITS if _wraps(table, channel, unit, bits)),
            f"counts_per_revolution = {COUNTS_PER_REVOLUTION[name]}{CHECK}of your encoder, quadrature included"
            if unit == "counts"
            else _resolution_line(table.channels.get(channel, np.zeros(1)), unit),
            f"sign = 1{CHECK}-1 where the value rises as the body turns clockwise (thesis Fig. 2.3)",
        ]  # fmt: skip
    problem = _import_problem(tables, "\n".join([*head, *body]))
    if "blow_start_s" in problem:
        head.append(f"blow_start_s = 0.0{CHECK}no rest before the push was found; when does the blow start?")
        problem = _import_problem(tables, "\n".join([*head, *body]))
    text = "\n".join([*head, *body]) + "\n"
    return {"mapping": text} | ({"does_not_import_yet": problem} if problem else {})


def _find_encoders(table: ChannelTable, excluded: list[str], group: str) -> dict[str, tuple[str, str]]:
    """Channel and unit (the file's, else counts for whole numbers, else rad) of each body's encoder that is told by its
    name, by body; none of ``excluded``, those of ``group`` first."""
    found: dict[str, tuple[str, str]] = {}
    for body in COUNTS_PER_REVOLUTION:
        name = _find_channel(table, body, excluded, group)
        if name is None:
            continue
        excluded = [*excluded, name]
        values = table.channels.get(name, np.zeros(1))
        unit = known_unit(table.units.get(name, "")) or ("counts" if np.all(values == np.round(values)) else "rad")
        found[body] = name, unit
    return found


def _resolution_line(angles: NDArray[np.float64], unit: str) -> str:
    steps = find_steps_of_turn(angles, 360.0 if unit == "deg" else 2.0 * np.pi)
    if steps is None:
        return f"counts_per_revolution = {STEPS_OF_ANGLES}  # angles are stored in steps of a turn by this"
    return f"counts_per_revolution = {steps}{CHECK}the readings go in steps of a turn by this"


def find_steps_of_turn(angles: NDArray[np.float64], turn: float) -> int | None:
    """Number of steps in one ``turn`` (360, or 2 pi, in the unit of the angles) on whose grid all readings (n,) lie, as
    those of an encoder do; None where no grid fits, or readings are too few."""
    known = np.unique(angles[np.isfinite(angles)])
    gaps = np.diff(known)
    gaps = gaps[gaps > turn / STEPS_OF_ANGLES]  # what lies closer is one reading
    if gaps.size < FEWEST_READINGS:
        return None
    way, step = known - known[0], float(gaps.min())
    reach = float(FEWEST_READINGS)
    while reach * step < 2.0 * way[-1]:  # the step is known the better the farther the readings lie
        near = way[way <= reach * step]
        number = np.round(near / step)
        step, reach = float(number @ near / (number @ number)) if number.any() else step, 4.0 * reach
    steps = round(turn / step)
    number = way * steps / turn
    return steps if steps < STEPS_OF_ANGLES and np.abs(number - np.round(number)).max() < OFF_GRID else None


def _wraps(table: ChannelTable, channel: str, unit: str, bits: int) -> bool:
    values = table.channels.get(channel, np.zeros(1))
    return unit == "counts" and bool(np.isfinite(values).all()) and has_wraps(values.astype(np.int64), bits)


def _time_lines(table: ChannelTable, time: str | None) -> list[str]:
    """Lines of the ``[time]`` table of a proposed mapping: the channel ``time`` and its unit, else a rate to check
    where the file states none or rounds it; none where the file's clock is enough."""
    if time is not None:
        return [f"channel = {toml_value(time)}", f"unit = {toml_value(known_unit(table.units.get(time, '')) or 's')}"]
    clock = next(iter(table.clocks.values()), None)
    if clock is None:
        return [f"sample_rate_hz = 1000.0{CHECK}the file states no times; with which rate was it recorded?"]
    if clock.is_rounded:
        low, high = (1.0 / (clock.interval_s + side * clock.resolution_s) for side in (0.5, -0.5))
        rate_hz = 1.0 / clock.interval_s
        return [f"sample_rate_hz = {rate_hz:.6g}{CHECK}the file rounds its interval: {low:.0f} to {high:.0f} Hz"]
    return []


def _force_lines(table: ChannelTable, force: str) -> list[str]:
    unit = known_unit(table.units.get(force, ""))
    said = "" if unit else f"{CHECK}the file states no unit of the force"
    lines = [f"channel = {toml_value(force)}", f"unit = {toml_value(unit or 'N')}{said}"]
    if unit is not None and unit not in NEWTONS:
        lines.append(f"newtons_per_unit = 1.0{CHECK}newtons per {unit}, by the calibration of the load cell")
    return lines


def _import_problem(tables: tuple[ChannelTable, ...], text: str) -> str:
    """Why the mapping of this ``text`` does not import the tables, as the message of its error; empty where it does.
    Nothing is written."""
    try:
        config = parse_mapping(text).config
        for number, table in enumerate(tables, 1):
            make_trial(table, config, number)
    except RigInputError as error:
        return str(error)
    return ""
