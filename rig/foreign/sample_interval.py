"""Interval between the samples of a recording: by its times, its own statement, or the mapping, which must agree."""

from __future__ import annotations

import re

from rig.errors import RigInputError
from rig.foreign.channel_table import SECONDS, ChannelTable, even_interval
from rig.foreign.mapping import ImportMapping, check_unit
from rig.foreign.units import known

RATES_HZ = (100.0, 1e6)
"""Sample rates a blow can have been recorded at; others mean a wrong unit of time."""
TIME_NAMES = re.compile(r"(t|time|zeit|temps|x_value)(_s)?", re.IGNORECASE)


def sample_interval(table: ChannelTable, mapping: ImportMapping) -> float:
    """Return the interval of the samples, s, by the mapping or the file.

    Raises RigInputError when they contradict each other, or no action was ever sampled like that.
    """
    time = mapping.time
    time_channel = time.channel if time.channel in table.channels or not table.clocks else None
    if time_channel is not None:
        check_unit(table, time_channel, time.unit, mapping.overrule_units)
    if time.sample_rate_hz is None:
        interval_s = table.interval(
            mapping.channels, time_channel, "time.sample_rate_hz in the mapping", unit=time.unit,
            same_start=time.same_start,
        )  # fmt: skip
    else:
        table.check_together(mapping.channels, time.same_start)
        interval_s = 1.0 / time.sample_rate_hz
        stated = table.stated_clock(mapping.channels)
        if stated is not None and not stated.agrees(interval_s):
            raise RigInputError(
                f"{table.where}: sample interval {stated.interval_s:g} s by the file itself, the mapping says "
                f"{interval_s:g} s"
            )
        _check_unmapped_times(table, table.channel(mapping.channels[0]).size, interval_s)
    rate_hz = 1.0 / interval_s
    if not RATES_HZ[0] <= rate_hz <= RATES_HZ[1]:
        raise RigInputError(
            f"{table.where}: sampled at {rate_hz:g} Hz, allowed {RATES_HZ[0]:g} to {RATES_HZ[1]:g} Hz; look at the "
            "unit of the times (time.unit in the mapping)"
        )
    return interval_s


def _check_unmapped_times(table: ChannelTable, size: int, interval_s: float) -> None:
    """Refuse a rate of the mapping that contradicts an unmapped column of even times in the file."""
    for name, values in table.channels.items():
        unit = known(table.units.get(name, "")) or ("s" if TIME_NAMES.fullmatch(name) else "")
        if unit not in SECONDS or values.size != size:
            continue
        try:
            found = even_interval(values * SECONDS[unit], name)
        except RigInputError:
            continue
        if abs(found - interval_s) * size > interval_s:
            raise RigInputError(
                f"{table.where}: {name} rises by {found:g} s, the mapping says {interval_s:g} s; name it as "
                "time.channel, or correct time.sample_rate_hz"
            )
