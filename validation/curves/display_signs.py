"""Names, symbols and signs of the thesis for the five bodies, for everything a person reads.

Conventions: key, hammer, jack and repetition lever: rest − angle; whippen: angle − rest; degrees.
"""

from __future__ import annotations

import numpy as np
import pandas as pd

from validation.conventions import Array

SIGN = {"key": -1.0, "whippen": 1.0, "jack": -1.0, "repetition": -1.0, "hammer": -1.0}
SYMBOL = {"key": "k", "whippen": "w", "jack": "j", "repetition": "r", "hammer": "h"}
TITLE = {
    "key": "key",
    "whippen": "whippen",
    "jack": "jack",
    "repetition": "repetition lever",
    "hammer": "hammer",
}


def rotation_label(channel: str) -> str:
    s = f"\\theta_{SYMBOL[channel]}"
    return f"${s} - {s}(0)$ (°)" if SIGN[channel] > 0 else f"${s}(0) - {s}$ (°)"


def degrees(channel: str, rad: pd.Series | Array) -> Array:
    """An angle or a difference of angles in degrees with the thesis's sign."""
    return SIGN[channel] * np.degrees(np.asarray(rad, dtype=float))
