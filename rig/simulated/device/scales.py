"""Scales of the channels: from what an input measures, V, to what the client reads, and back for an output.

Custom scales go by name. Linear, map and table scales are monotonic, so one rule serves both ways; a polynomial scale
has one for each. Values beyond a table are clipped to its ends, as the driver does. Thermocouples J, K, T and E follow
the reference functions of ITS-90, from volts at a terminal and the temperature of the cold junction to that of the hot
one, deg C; beyond the range of a type a reading stays at its end.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rig.simulated import daqmx
from rig.simulated.status import Code, DaqStatusError, refuse_any

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
        return self._carried(value, "PRE_SCALED", "SCALED", "FORWARD")

    def prescaled(self, value: ArrayLike) -> Array:
        """Return what stands at the terminal, for what the client says."""
        return self._carried(value, "SCALED", "PRE_SCALED", "REVERSE")

    def _carried(self, value: ArrayLike, from_side: str, to_side: str, way: str) -> Array:
        x, own = np.asarray(value, dtype=np.float64), self.values
        if self.type == LINEAR:
            slope, intercept = own["LIN_SLOPE"], own["LIN_Y_INTERCEPT"]
            return x * slope + intercept if way == "FORWARD" else (x - intercept) / slope
        if self.type == MAP:
            return _mapped(x, self._ends(from_side), self._ends(to_side))
        if self.type == POLYNOMIAL:
            return np.polynomial.polynomial.polyval(x, own[f"POLY_{way}_COEFF"])
        return _interpolated(x, own[f"TABLE_{from_side}_VALS"], own[f"TABLE_{to_side}_VALS"])

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
        detail = f"Scale: {self.name}"
        refuse_any(
            (
                len(prescaled) != len(scaled),
                Code.TABLE_SCALE_NUM_PRE_SCALED_AND_SCALED_VALS_NOT_EQUAL,
                f"{detail}: {len(prescaled)} and {len(scaled)} values",
            ),
            (len(prescaled) < 2, Code.FEWER_THAN_2_PRE_SCALED_VALS, detail),
            (len(set(prescaled)) < len(prescaled), Code.REPEATED_NUMBER_IN_PRE_SCALED_VALUES, detail),
            (len(set(scaled)) < len(scaled), Code.REPEATED_NUMBER_IN_SCALED_VALUES, detail),
        )


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


J, K, T, E = 10072, 10073, 10086, 10055
DEG_C, DEG_F, KELVIN, DEG_R = 10143, 10144, 10325, 10145
PER_CELSIUS = {DEG_C: (1.0, 0.0), DEG_F: (1.8, 32.0), KELVIN: (1.0, 273.15), DEG_R: (1.8, 491.67)}
"""Factor and offset from deg C."""

# NIST monograph 175: range in deg C, coefficients in mV, lowest power first
_PARTS: dict[int, tuple[tuple[float, float, tuple[float, ...]], ...]] = {
    J: (
        (-210.0, 760.0, (
            0.0, 0.503811878150e-1, 0.304758369300e-4, -0.856810657200e-7, 0.132281952950e-9, -0.170529583370e-12,
            0.209480906970e-15, -0.125383953360e-18, 0.156317256970e-22,
        )),
    ),
    K: (
        (-270.0, 0.0, (
            0.0, 0.394501280250e-1, 0.236223735980e-4, -0.328589067840e-6, -0.499048287770e-8, -0.675090591730e-10,
            -0.574103274280e-12, -0.310888728940e-14, -0.104516093650e-16, -0.198892668780e-19, -0.163226974860e-22,
        )),
        (0.0, 1372.0, (
            -0.176004136860e-1, 0.389212049750e-1, 0.185587700320e-4, -0.994575928740e-7, 0.318409457190e-9,
            -0.560728448890e-12, 0.560750590590e-15, -0.320207200030e-18, 0.971511471520e-22, -0.121047212750e-25,
        )),
    ),
    T: (
        (-270.0, 0.0, (
            0.0, 0.387481063640e-1, 0.441944343470e-4, 0.118443231050e-6, 0.200329735540e-7, 0.901380195590e-9,
            0.226511565930e-10, 0.360711542050e-12, 0.384939398830e-14, 0.282135219250e-16, 0.142515947790e-18,
            0.487686622860e-21, 0.107955392700e-23, 0.139450270620e-26, 0.797951539270e-30,
        )),
        (0.0, 400.0, (
            0.0, 0.387481063640e-1, 0.332922278800e-4, 0.206182434040e-6, -0.218822568460e-8, 0.109968809280e-10,
            -0.308157587720e-13, 0.454791352900e-16, -0.275129016730e-19,
        )),
    ),
    E: (
        (-270.0, 0.0, (
            0.0, 0.586655087080e-1, 0.454109771240e-4, -0.779980486860e-6, -0.258001608430e-7, -0.594525830570e-9,
            -0.932140586670e-11, -0.102876055340e-12, -0.803701236210e-15, -0.439794973910e-17, -0.164147763550e-19,
            -0.396736195160e-22, -0.558273287210e-25, -0.346578420130e-28,
        )),
        (0.0, 1000.0, (
            0.0, 0.586655087100e-1, 0.450322755820e-4, 0.289084072120e-7, -0.330568966520e-9, 0.650244032700e-12,
            -0.191974955040e-15, -0.125366004970e-17, 0.214892175690e-20, -0.143880417820e-23, 0.359608994810e-27,
        )),
    ),
}  # fmt: skip
_K_BUMP = (0.118597600000, -0.118343200000e-3, 126.9686)


def millivolts(kind: int, celsius: ArrayLike) -> Array:
    """Return the voltage of a thermocouple whose cold junction is at 0 deg C, mV."""
    at, out = np.asarray(celsius, dtype=np.float64), np.zeros(np.shape(celsius))
    for low, _, coefficients in _PARTS[kind]:
        value = np.polynomial.polynomial.polyval(at, coefficients)
        if kind == K and low == 0.0:
            a, b, c = _K_BUMP
            value = value + a * np.exp(b * (at - c) ** 2)
        out = np.where(at >= low, value, out)
    return out


@cache
def _table(kind: int) -> tuple[Array, Array]:
    celsius = np.arange(_PARTS[kind][0][0], _PARTS[kind][-1][1] + 0.25, 0.5)
    return millivolts(kind, celsius), celsius


@dataclass(frozen=True)
class ThermocoupleScale:
    """From volts to a temperature in the client's units and back, with the cold junction at ``cold_celsius``."""

    kind: int
    cold_celsius: float
    units: int = DEG_C
    name: str = field(default="", init=False)

    def scaled(self, value: ArrayLike) -> Array:
        """Return what the client reads, for volts."""
        factor, offset = PER_CELSIUS[self.units]
        table_mv, celsius = _table(self.kind)
        total_mv = 1e3 * np.asarray(value, dtype=np.float64) + millivolts(self.kind, self.cold_celsius)
        return np.interp(total_mv, table_mv, celsius) * factor + offset

    def prescaled(self, value: ArrayLike) -> Array:
        """Return the volts of a temperature."""
        factor, offset = PER_CELSIUS[self.units]
        celsius = (np.asarray(value, dtype=np.float64) - offset) / factor
        return 1e-3 * (millivolts(self.kind, celsius) - millivolts(self.kind, self.cold_celsius))
