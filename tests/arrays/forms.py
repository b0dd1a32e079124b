"""One array in every form in which users have it, and what no function can take."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, is_dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray

Form = Callable[[np.ndarray], Any]


def _whole(a: np.ndarray) -> bool:
    return bool(np.array_equal(a, np.rint(a)))


def _read_only(a: np.ndarray) -> np.ndarray:
    out = a.copy()
    out.setflags(write=False)
    return out


def _strided(a: np.ndarray) -> np.ndarray:
    """Every second element of a larger array along every axis, the gaps full of something else."""
    wide = np.full([2 * n + 1 for n in a.shape], 77).astype(a.dtype)
    part = wide[tuple(slice(1, 1 + 2 * n, 2) for n in a.shape)]
    part[...] = a
    return part


def _backwards(a: np.ndarray) -> np.ndarray:
    turned = (slice(None, None, -1),) * a.ndim
    return np.ascontiguousarray(a[turned])[turned]


def _table(a: np.ndarray) -> Any:
    """A column or a table of pandas, its index another than counts from 0: what is read must not depend on it."""
    if a.ndim == 1:
        return pd.Series(a, index=np.arange(len(a))[::-1] + 5)
    return pd.DataFrame(a, index=np.arange(len(a))[::-1] + 5) if a.ndim == 2 else a


def _hard(a: np.ndarray) -> np.ndarray:
    out = _backwards(_strided(a)).astype(a.dtype.newbyteorder(">"))[::-1][::-1]
    out.setflags(write=False)
    return out


def _tuple(a: np.ndarray) -> Any:
    return tuple(_tuple(row) for row in a) if a.ndim else a.item()


FORMS: dict[str, Form] = {
    "read-only": _read_only,
    "strided": _strided,
    "backwards": _backwards,
    "columns first": np.asfortranarray,
    "big-endian": lambda a: a.astype(a.dtype.newbyteorder(">")),
    "float32": lambda a: a.astype(np.float32) if a.dtype.kind == "f" else a,
    "whole": lambda a: a.astype(np.int64) if _whole(a) else a,
    "small whole": lambda a: a.astype(np.int16) if _whole(a) and abs(a).max(initial=0) < 2**15 else a,
    "list": lambda a: a.tolist(),
    "tuple": _tuple,
    "pandas": _table,
    "index": lambda a: pd.Index(a) if a.ndim == 1 else a,
    "xarray": xarray.DataArray,
    "masked, nothing hidden": np.ma.masked_array,
    "hard": _hard,
}

REFUSED: dict[str, Form] = {
    "complex": lambda a: a + 1j,
    "complex under a mask": lambda a: np.ma.masked_array(a + 1j),
    "texts": lambda a: a.astype(str),
    "objects": lambda a: np.array([object()] * max(a.size, 1)).reshape(a.shape if a.size else 1),
    "dates": lambda a: np.zeros(a.shape, "datetime64[s]"),
    "ragged": lambda a: [[0.0], [0.0, 1.0]],
}
DIMENSIONS: dict[str, Form] = {"one more": lambda a: a[None], "none": lambda a: np.float64(1.0)}


def plain(a: Any) -> np.ndarray:
    """An array whose numbers float32 holds, so that its forms are the same numbers."""
    array = np.asarray(a)
    return np.ascontiguousarray(array.astype(np.float32).astype(float)) if array.dtype.kind == "f" else array


@dataclass(frozen=True)
class Gives:
    """A function that a user hands over; what it gives is an array as well."""

    function: Callable[..., Any]


@dataclass(frozen=True)
class Out:
    """A file to write; its bytes are part of the answer."""

    name: str


def changed(value: Any, form: Form) -> Any:
    """A value with every array in it in a form."""
    if isinstance(value, np.ndarray):
        return form(plain(value))
    if isinstance(value, Gives):
        return lambda *a: changed(value.function(*a), form)
    if isinstance(value, dict):
        return {k: changed(v, form) for k, v in value.items()}
    if isinstance(value, (list, tuple)) and any(isinstance(v, (np.ndarray, tuple, Gives)) for v in value):
        return type(value)(changed(v, form) for v in value)
    if is_dataclass(value) and type(value).__name__.endswith("Options"):
        given = {f.name: getattr(value, f.name) for f in fields(value)}
        return replace(value, **{k: form(plain(v)) for k, v in given.items() if isinstance(v, np.ndarray)})
    return value


def answer(value: Any) -> Any:
    """What can be compared of an answer: its arrays as bytes of plain ones, its numbers and texts."""
    if isinstance(value, np.ndarray):
        return value.shape, value.dtype.str, np.ascontiguousarray(value).tobytes()
    if isinstance(value, (pd.Series, pd.DataFrame)):
        return answer(value.to_numpy())
    if isinstance(value, Path):
        return value.read_bytes()
    if is_dataclass(value) and not isinstance(value, type):
        return {f.name: answer(getattr(value, f.name)) for f in fields(value) if "wall" not in f.name}
    if isinstance(value, dict):
        return {k: answer(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [answer(v) for v in value]
    if isinstance(value, (float, np.floating)):
        return repr(float(value))
    return value if isinstance(value, (int, str, bool, bytes, type(None))) else type(value).__name__
