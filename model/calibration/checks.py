"""Checks of measured numbers before they are used in a calibration."""

from __future__ import annotations

import math
from collections.abc import Mapping

from model.errors import InputError


def check_numbers(what: str, values: Mapping[str, float], uncertainties: Mapping[str, float], unit: str = "") -> None:
    """Refuse values that are not above 0 and standard uncertainties that are negative; names come with their numbers.

    Raises
    ------
    InputError : names the first number of ``what`` that cannot be used
    """
    unit = f" {unit}" if unit else ""
    for name, value in values.items():
        if not (math.isfinite(value) and value > 0.0):
            raise InputError(f"{what}: {name} found {value:g}{unit}, allowed above 0")
    for name, value in uncertainties.items():
        if not (math.isfinite(value) and value >= 0.0):
            raise InputError(f"{what}: u of {name} found {value:g}{unit}, allowed from 0")
