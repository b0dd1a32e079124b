"""Arrays on their way to the browser: 32-bit numbers in base64, a third of the size of the same numbers as text."""

from __future__ import annotations

import base64
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray


def pack(values: ArrayLike) -> dict[str, Any]:
    """``{"f32": base64, "shape": [...]}``; NaN stays NaN. A 32-bit number keeps seven digits, for drawing.

    Examples
    --------
    >>> pack([1.0, float("nan")])
    {'f32': 'AACAPwAAwH8=', 'shape': [2]}
    """
    array = np.ascontiguousarray(values, dtype="<f4")
    return {"f32": base64.b64encode(array.tobytes()).decode("ascii"), "shape": list(array.shape)}


def unpack(packed: dict[str, Any]) -> NDArray[np.float32]:
    """The numbers of `pack`.

    Examples
    --------
    >>> unpack(pack([1.0, 2.5])).tolist()
    [1.0, 2.5]
    """
    return np.frombuffer(base64.b64decode(packed["f32"]), dtype="<f4").reshape(packed["shape"])
