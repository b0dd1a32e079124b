"""Custom scales of a client, by name: from what an input measures, V, to what the lab calls it, and back for an output.

Linear, map and table scales are monotonic, so one rule serves both ways; a polynomial scale has one for each. Values
beyond a table are clipped to its ends, as the driver does.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rig.simulated import daqmx
from rig.simulated.status import Code, DaqStatusError

LINEAR, MAP, POLYNOMIAL, TABLE = 10447, 10448, 10449, 10450
Array = NDArray[np.float64]


@dataclass(eq=False)
class CustomScale:
    """One scale; ``values`` are its properties by the driver's names, ``LIN_SLOPE``, ``TABLE_SCALED_VALS`` …"""

    name: str
    type: int
    values: dict[str, Any]
    prescaled_units: int = daqmx.VOLTS
    scaled_units: str = ""
    description: str = ""

    def scaled(self, value: ArrayLike) -> Array:
        """Return what the client sees, for what is measured."""
        x, own = np.asarray(value, dtype=np.float64), self.values
        if self.type == LINEAR:
            return x * own["LIN_SLOPE"] + own["LIN_Y_INTERCEPT"]
        if self.type == MAP:
            return _mapped(x, self._ends("PRE_SCALED"), self._ends("SCALED"))
        if self.type == POLYNOMIAL:
            return np.polynomial.polynomial.polyval(x, own["POLY_FORWARD_COEFF"])
        return _interpolated(x, own["TABLE_PRE_SCALED_VALS"], own["TABLE_SCALED_VALS"])

    def prescaled(self, value: ArrayLike) -> Array:
        """Return what stands at the terminal, for what the client says."""
        y, own = np.asarray(value, dtype=np.float64), self.values
        if self.type == LINEAR:
            return (y - own["LIN_Y_INTERCEPT"]) / own["LIN_SLOPE"]
        if self.type == MAP:
            return _mapped(y, self._ends("SCALED"), self._ends("PRE_SCALED"))
        if self.type == POLYNOMIAL:
            return np.polynomial.polynomial.polyval(y, own["POLY_REVERSE_COEFF"])
        return _interpolated(y, own["TABLE_SCALED_VALS"], own["TABLE_PRE_SCALED_VALS"])

    def _ends(self, side: str) -> tuple[float, float]:
        return self.values[f"MAP_{side}_MIN"], self.values[f"MAP_{side}_MAX"]

    def check(self) -> None:
        """Refuse what no scale can be; raises DaqStatusError with the driver's code."""
        own = self.values
        if self.type == LINEAR and own["LIN_SLOPE"] == 0.0:
            raise DaqStatusError(Code.ZERO_SLOPE_LINEAR_SCALE, f"Scale: {self.name}")
        if self.type == MAP:
            for side, code in (("PRE_SCALED", Code.PRE_SCALED_MIN_EQUAL_MAX), ("SCALED", Code.SCALED_MIN_EQUAL_MAX)):
                low, high = self._ends(side)
                if low == high:
                    raise DaqStatusError(code, f"Scale: {self.name}: {low:g}")
        if self.type == POLYNOMIAL:
            for side, code in (
                ("FORWARD", Code.ZERO_FORWARD_POLY_SCALE_COEFFS),
                ("REVERSE", Code.ZERO_REVERSE_POLY_SCALE_COEFFS),
            ):
                if not any(own[f"POLY_{side}_COEFF"]):
                    raise DaqStatusError(code, f"Scale: {self.name}")
        if self.type == TABLE:
            self._check_table(own["TABLE_PRE_SCALED_VALS"], own["TABLE_SCALED_VALS"])

    def _check_table(self, prescaled: Sequence[float], scaled: Sequence[float]) -> None:
        if len(prescaled) != len(scaled):
            raise DaqStatusError(
                Code.TABLE_SCALE_NUM_PRE_SCALED_AND_SCALED_VALS_NOT_EQUAL,
                f"Scale: {self.name}: {len(prescaled)} and {len(scaled)} values",
            )
        if len(prescaled) < 2:
            raise DaqStatusError(Code.FEWER_THAN_2_PRE_SCALED_VALS, f"Scale: {self.name}")
        for values, code in (
            (prescaled, Code.REPEATED_NUMBER_IN_PRE_SCALED_VALUES),
            (scaled, Code.REPEATED_NUMBER_IN_SCALED_VALUES),
        ):
            if len(set(values)) < len(values):
                raise DaqStatusError(code, f"Scale: {self.name}")


def _mapped(x: Array, old: tuple[float, float], new: tuple[float, float]) -> Array:
    return np.asarray(new[0] + (x - old[0]) * ((new[1] - new[0]) / (old[1] - old[0])))


def _interpolated(x: Array, at: Sequence[float], values: Sequence[float]) -> Array:
    order = np.argsort(at)
    return np.interp(x, np.asarray(at, dtype=float)[order], np.asarray(values, dtype=float)[order])


def scale_of(scales: dict[str, CustomScale], name: str, units: tuple[int, ...]) -> CustomScale:
    """Return the scale a channel names, of what it measures in one of these units."""
    scale = find_scale(scales, name)
    if scale.prescaled_units not in units:
        detail = f"Scale: {name!r} is of units {scale.prescaled_units}, allowed {', '.join(map(str, units))}"
        raise DaqStatusError(Code.INVALID_ATTRIBUTE_VALUE, detail)
    return scale


def find_scale(scales: dict[str, CustomScale], name: str) -> CustomScale:
    """Return a scale by name; the driver does not tell upper from lower case."""
    if name.lower() not in scales:
        raise DaqStatusError(Code.CUSTOM_SCALE_DOES_NOT_EXIST, f"Scale: {name!r}")
    return scales[name.lower()]
