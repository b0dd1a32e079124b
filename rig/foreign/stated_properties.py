"""What the properties of a channel in a binary file say of its numbers: unit, scale and sample rate.

Programs name them as they like, so they are found by words. A unit and a rate must then agree with the mapping. A
number that may be a scale and belongs to no convention known here is a doubt: the channel is refused unless the mapping
overrules the file.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from rig.foreign.channel_table import SYNONYMS, known_unit
from rig.foreign.sample_times import Clock

Properties = Mapping[str, Any]
"""Values by name: numbers, texts, bytes or arrays of one."""

_UNIT = re.compile(r"(unit|units|unit_string|ni_unitdescription|y_?units?)", re.IGNORECASE)
"""Properties that are the unit of the numbers, whatever they say."""
_PERHAPS_UNIT = re.compile(r"(?!ni_scale|x|t_|wf_|time|index).*(unit|einheit).*", re.IGNORECASE)
"""Properties that are it where they say a known one."""
_SCALE = re.compile(
    r"(?!ni_|wf_|.*(date|serial|number|name|due|file)).*(scale|scaling|gain|slope|sensitivity|conversion|multipl|factor|calib|offset|intercept|lsb|"
    r"per_?(bit|count|digit|lsb)).*",
    re.IGNORECASE,
)
_SCALE_OF_INTEGERS = re.compile(r"(?!ni_|wf_).*(resolution|quantum|step_?size).*", re.IGNORECASE)
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?(?=\s*($|[^\d\s.:,/-]))")
_RATE = re.compile(r"(sampl(e|es|ing)|scan|acquisition|daq)(rate|freq|frequency|persec|persecond)(hz)?|fs|fshz")
_INTERVAL = re.compile(r"dt|deltat|timestep|sampl(e|ing)(interval|period)(s|sec)?|wfincrement|xincrement")


def is_unit_scale_or_time(name: str) -> bool:
    """Whether a property's name says that it is a unit, scale, sample rate, interval or start of a channel's numbers;
    its value is not looked at."""
    letters = _letters(name)
    return bool(
        _PERHAPS_UNIT.fullmatch(name)
        or _SCALE.fullmatch(name)
        or _RATE.fullmatch(letters)
        or _INTERVAL.fullmatch(letters)
        or re.fullmatch(r"wf_(increment|start_time|start_offset|xunit_string)|NI_.*Scal.*", name)
    )


def find_unit(properties: Properties) -> tuple[str, str]:
    """Unit that the properties state, as written (empty for none), and a text that says where two of them contradict
    each other (the unit is then empty), else empty."""
    found = {}
    for key, value in properties.items():
        text = text_of(value).strip()
        if _UNIT.fullmatch(key) and known_unit(text) or _PERHAPS_UNIT.fullmatch(key) and text.lower() in SYNONYMS:
            found[key] = text
    if len({known_unit(text) for text in found.values()}) > 1:
        return "", f"the units that the file states contradict each other: {found}"
    return next(iter(found.values()), ""), ""


def find_scale_doubt(properties: Properties, applied: tuple[str, ...] = (), *, are_integers: bool = False) -> str:
    """Sentence on the first property that by its name may be a scale, is not neutral (factor 1, offset 0) and not in
    ``applied``; empty where there is none. ``are_integers``: resolutions count, too."""
    for key, value in scale_numbers(properties, are_integers=are_integers):
        neutral = 0.0 if re.search("offset|intercept", key, re.IGNORECASE) else 1.0
        if key not in applied and value != neutral:
            said = text_of(properties[key]) if np.isfinite(value) else "several numbers"
            return (
                f"the file's property {key} = {said} may be a scale; name the channel in overrule_units of the mapping "
                "to take its numbers as they are"
            )
    return ""


def find_scale_doubt_of_groups(name: str, above: Sequence[Properties], *, are_integers: bool) -> str:
    short = name.rpartition("/")[2].lower()
    for properties in above:
        of_channel = {key: value for key, value in properties.items() if are_integers or short in key.lower()}
        if doubt := find_scale_doubt(of_channel, are_integers=are_integers):
            return doubt
    return ""


def scale_numbers(properties: Properties, *, are_integers: bool = False) -> Iterator[tuple[str, float]]:
    """Yield name and number of each property that by its name may be a factor or offset; NaN where it holds several
    numbers. ``are_integers``: also resolutions and step sizes."""
    for key, value in properties.items():
        if not _SCALE.fullmatch(key) and not (are_integers and _SCALE_OF_INTEGERS.fullmatch(key)):
            continue
        if np.size(value) != 1:
            if np.asarray(value).dtype.kind in "iuf":
                yield key, np.nan
        elif found := _NUMBER.match(text_of(value).strip()):
            yield key, float(found[0])


def find_clock(*properties: Properties) -> Clock | None:
    """Clock of the first sample rate, Hz, or sample interval, s, that a property states by its name; the sets of
    properties are searched in order; None where none does."""
    for stated in properties:
        for key, value in stated.items():
            letters = _letters(key)
            is_rate = _RATE.fullmatch(letters)
            if (is_rate or _INTERVAL.fullmatch(letters)) and np.size(value) == 1:
                try:
                    number = float(text_of(value))
                except ValueError:
                    continue
                if number > 0 and np.isfinite(number):
                    return Clock(1.0 / number if is_rate else number, source=key)
    return None


def _letters(name: str) -> str:
    return re.sub(r"[^a-z]", "", name.lower())


def text_of(value: Any) -> str:
    if isinstance(value, np.ndarray):
        value = value.reshape(-1)[0] if value.size == 1 else ""
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)
