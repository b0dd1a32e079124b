"""A string: numbers, checked, with the frequencies and losses of its modes.

The string is stiff, pinned at both ends and loses energy by air (b1) and within (b2), as in A. Chaigne and
A. Askenfelt, J. Acoust. Soc. Am. 95 (1994) 1112, with the loss law of J. Bensa et al., J. Acoust. Soc. Am. 114 (2003)
1095. Its second polarisation and the bridge's motion are left out.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.arrays import as_numbers
from model.errors import InputError

Array = NDArray[np.float64]


def check_numbers(what: str, **numbers: tuple[float, float, float]) -> None:
    """Refuse numbers (value, lowest, highest) out of range."""
    for name, (value, low, high) in numbers.items():
        if not (math.isfinite(value) and low <= value <= high):
            raise InputError(f"{what}: {name} found {value:g}, allowed {low:g} to {high:g}")


@dataclass(frozen=True)
class String:
    # length_m, mass_kg, tension_n: of the speaking length
    length_m: float
    mass_kg: float
    tension_n: float
    stiffness: float  # epsilon, (bending stiffness) / (tension x length^2); inharmonicity is pi^2 epsilon
    # b1_per_s, b2_m2_per_s: losses; a mode of wave number k decays at b1 + b2 k^2
    b1_per_s: float
    b2_m2_per_s: float
    struck_at: float  # place of the hammer as a share of the length

    def __post_init__(self) -> None:
        check_numbers(
            "string",
            length_m=(self.length_m, 0.01, 3.0),
            mass_kg=(self.mass_kg, 1e-5, 1.0),
            tension_n=(self.tension_n, 1.0, 1e4),
            stiffness=(self.stiffness, 0.0, 0.01),
            b1_per_s=(self.b1_per_s, 0.0, 100.0),
            b2_m2_per_s=(self.b2_m2_per_s, 0.0, 0.1),
            struck_at=(self.struck_at, 1e-3, 0.999),
        )

    @property
    def modal_mass_kg(self) -> float:
        return 0.5 * self.mass_kg

    def wave_number(self, n: ArrayLike) -> Array:
        """Wave numbers, 1/m, of modes (k,), which count from 1."""
        return as_numbers(n, "modes") * math.pi / self.length_m

    def omega(self, n: ArrayLike) -> Array:
        """Angular frequencies, rad/s, of modes (k,) without loss."""
        first = math.pi / self.length_m * math.sqrt(self.tension_n * self.length_m / self.mass_kg)
        n = as_numbers(n, "modes")
        return np.asarray(n * first * np.sqrt(1.0 + math.pi**2 * self.stiffness * n**2))

    def decay(self, n: ArrayLike) -> Array:
        """Decay rates, 1/s, of modes (k,)."""
        return self.b1_per_s + self.b2_m2_per_s * self.wave_number(n) ** 2

    def shape(self, n: ArrayLike) -> Array:
        """Height of modes (k,) at the hammer."""
        return np.asarray(np.sin(as_numbers(n, "modes") * math.pi * self.struck_at))
