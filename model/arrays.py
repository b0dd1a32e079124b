"""Arrays as users have them, made such as compiled code takes: by `as_numbers` where a function is entered, by
`ArrayRecord` where a record is made.
"""

from __future__ import annotations

import re
from dataclasses import fields
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from model.errors import InputError


def as_numbers(values: ArrayLike, where: str, ndim: int | None = None, dtype: DTypeLike = np.float64) -> NDArray[Any]:
    """``values`` as a contiguous array of ``dtype`` with ``ndim`` dimensions (None: any), itself where it is one, NaN
    where masked; `InputError`, beginning with ``where``, for what is not real, or not whole if ``dtype`` is."""
    if type(values) is np.ndarray and values.dtype == dtype and values.flags.carray:
        found = out = values
    else:
        try:
            shown = (
                np.where(np.ma.getmaskarray(values), np.nan, np.ma.getdata(values)) if np.ma.isMA(values) else values
            )
            found = np.asarray(shown)
        except (TypeError, ValueError):
            raise InputError(f"{where}: found values that form no array, allowed rows of real numbers") from None
        if found.dtype.kind not in "biuf":
            raise InputError(f"{where}: found values of type {found.dtype.name}, allowed real numbers; convert them")
        with np.errstate(invalid="ignore", over="ignore"):
            out = np.require(found, dtype, ["C", "W"])
        if out.dtype.kind in "iu" and not np.array_equal(out, found):
            low, high = np.iinfo(out.dtype).min, np.iinfo(out.dtype).max
            raise InputError(f"{where}: found broken or too large numbers, allowed whole ones from {low} to {high}")
    if ndim is not None and out.ndim != ndim:
        raise InputError(f"{where}: found shape {out.shape}, allowed {ndim} dimension{'s' * (ndim > 1)}")
    return out


class ArrayRecord:
    """A dataclass whose fields that are annotated as arrays pass through `as_numbers` when it is made."""

    def __post_init__(self) -> None:
        for name, dtype in _array_fields(type(self)):  # type: ignore[arg-type]  # a class can be hashed
            values = getattr(self, name)
            if values is not None:
                object.__setattr__(self, name, as_numbers(values, f"{type(self).__name__}.{name}", None, dtype))


@cache
def _array_fields(kind: Any) -> tuple[tuple[str, np.dtype[Any]], ...]:
    """Names and types of the fields of a dataclass that are annotated as arrays."""
    annotation = re.compile(r"(?:Array|NDArray\[np\.(\w+)\])(?: \| None)?")
    found = ((field.name, annotation.fullmatch(str(field.type))) for field in fields(kind))
    return tuple((name, np.dtype((match[1] or "float64").rstrip("_"))) for name, match in found if match)
