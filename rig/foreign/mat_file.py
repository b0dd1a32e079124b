"""MATLAB files before 7.3, by SciPy: every vector of numbers, also in a struct, as ``name`` or ``struct/name``.

They state no units but those of a struct ``units``, as the export of a trial writes it; a single number is a property
of the file. Files of 7.3 are HDF5.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from rig.errors import RigInputError
from rig.foreign.channel_table import ChannelTable
from rig.foreign.stated_properties import find_clock, find_scale_doubt_of_groups


def read_mat(path: Path) -> ChannelTable:
    """Read every vector of numbers of a MATLAB file before 7.3 (SciPy), also those in structs, as channels;
    RigInputError when it cannot be read or has none."""
    from scipy.io import loadmat  # start-up: 0.2 s that only a MATLAB file needs

    try:
        content = loadmat(path, squeeze_me=True, struct_as_record=False)
    except Exception as error:  # a damaged file makes SciPy raise nearly anything
        raise RigInputError(f"{path}: not a readable MATLAB file ({' '.join(str(error).split())[:120]})") from None
    entries = dict(_flatten_structs(content))
    scalars = {name: value for name, value in entries.items() if np.size(value) == 1 and not isinstance(value, str)}
    stated = {name.rpartition("/")[2]: str(text) for name, text in entries.items() if "units/" in name}
    channels, unreadable, doubts, clocks = {}, {}, {}, {}
    for name, value in entries.items():
        if not isinstance(value, np.ndarray) or value.size < 2 or value.dtype.kind not in "iufb":
            continue
        if value.ndim > 1:
            unreadable[name] = f"{name} is a table of {value.shape} numbers, allowed a vector"
            continue
        channels[name] = value.astype(np.float64)
        if doubt := find_scale_doubt_of_groups(name, [scalars], are_integers=value.dtype.kind in "iu"):
            doubts[name] = f"{name}: {doubt}"
        if clock := find_clock({key.rpartition("/")[2]: number for key, number in scalars.items()}):
            clocks[name] = clock
    if not channels:
        raise RigInputError(f"{path}: no vector of numbers{''.join(f'; {reason}' for reason in unreadable.values())}")
    units = {name: stated[name] for name in channels if name in stated}
    return ChannelTable(str(path), channels, units, clocks, unreadable, doubts)


def _flatten_structs(content: Any, above: str = "") -> Iterator[tuple[str, Any]]:
    """Yield name and value of every variable, of a field of a struct as ``struct/field``, at any depth; names that
    begin with ``_`` are left out."""
    fields = content if isinstance(content, dict) else vars(content)
    for name, value in fields.items():
        if name.startswith("_"):
            continue
        if hasattr(value, "_fieldnames"):
            yield from _flatten_structs(value, f"{above}{name}/")
        else:
            yield above + name, value
