"""A hammer at a string, and a string to begin with."""

from __future__ import annotations

import math
from dataclasses import dataclass

from model.errors import InputError
from model.parameters.string import String as String
from model.parameters.string import check_numbers


@dataclass(frozen=True)
class Hammer:
    """A hammer's mass at the string and its felt, (a x^3 + b x^2 + c x + k x^p) (1 + D dx/dt).

    Attributes
    ----------
    mass_kg : effective, along its way
    a, b, c, d : of eqs 2.4 and 2.5; 0 where the felt is a power law
    k, p : of a power law, N/m^p; 0 where the felt is the cubic
    """

    mass_kg: float
    a: float = 0.0
    b: float = 0.0
    c: float = 0.0
    d: float = 0.0
    k: float = 0.0
    p: float = 2.5

    def __post_init__(self) -> None:
        """Refuse what is no hammer."""
        check_numbers("hammer", mass_kg=(self.mass_kg, 1e-4, 1.0), a=(self.a, 0.0, math.inf), c=(self.c, 0.0, math.inf))
        check_numbers("hammer", d=(self.d, 0.0, math.inf), k=(self.k, 0.0, math.inf), p=(self.p, 1.0, 6.0))
        if self.a + self.c + self.k <= 0.0 and self.b <= 0.0:
            raise InputError("hammer: a, b, c and k found 0, allowed a felt that presses")


C4 = String(0.62, 3.934e-3, 670.0, 3.82e-5, 1.1, 2.7e-4, 0.12)
"""C4 of a grand: length to stiffness and the place of the hammer after Chaigne and Askenfelt, losses after Bensa."""
C4_HAMMER = Hammer(2.97e-3, k=4.5e9, p=2.5)
"""Its hammer, from the same source."""
