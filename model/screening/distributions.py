"""How parameters vary: normally about their value with the declared standard uncertainty, within what is allowed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtr, ndtri

from model.arrays import as_numbers
from model.errors import InputError
from model.parameters.action import Action
from model.parameters.quantity import allowed_range
from model.sensitivity.parameter_names import Parameter, find_parameters

Array = NDArray[np.float64]

WIDEST = 3.0  # standard uncertainties from the value to the ends of what is drawn


@dataclass(frozen=True)
class Spread:
    """A parameter with its standard uncertainty ``u`` and the ends of what is drawn, in its unit."""

    parameter: Parameter
    u: float
    low: float
    high: float

    def at(self, share: ArrayLike) -> Array:
        """Values below which these shares (0 to 1) of the distribution lie."""
        low, high = (ndtr((end - self.parameter.value) / self.u) for end in (self.low, self.high))
        value = self.parameter.value + self.u * ndtri(low + as_numbers(share, "shares") * (high - low))
        return np.asarray(np.clip(value, self.low, self.high))


def spreads(action: Action, names: Sequence[str], uncertainties: Mapping[str, float] | None = None) -> list[Spread]:
    """Spreads of named parameters: declared uncertainties, or those given here.

    Parameters
    ----------
    action : parameter set
    names : as for `model.sensitivities`
    uncertainties : name -> standard uncertainty in the parameter's unit (of a factor: relative), not the declared

    Returns
    -------
    list of Spread
        In the order of the names.

    Raises
    ------
    InputError : a parameter has no uncertainty, one is not above 0, or one is given for another name

    Examples
    --------
    >>> import model
    >>> mass, friction = model.screening.spreads(model.load_action(), ["hammer.mass", "friction"], {"friction": 0.1})
    >>> friction.u, mass.u > 0.0
    (0.1, True)
    """
    given = dict(uncertainties or {})
    out, missing = [], []
    for parameter in find_parameters(action, names):
        quantity = action.quantities.get(parameter.name) or action.effects.get(parameter.name)
        u = given.pop(parameter.name, quantity.u if quantity is not None else 0.0)
        if not (np.isfinite(u) and u >= 0.0):
            raise InputError(f"uncertainty of {parameter.name}: found {u:g}, allowed above 0")
        if u == 0.0:
            missing.append(parameter.name)
            continue
        low, high = parameter.value - WIDEST * u, parameter.value + WIDEST * u
        for path, weight in parameter.paths.items():
            least, most, _ = allowed_range(path)
            base = action[path]
            ends = sorted(parameter.value + (end - base) / weight for end in (least, most)) if weight else (low, high)
            # not onto the end itself: there a law may be switched off, or a mass zero
            low, high = max(low, ends[0] + 1e-6 * u), min(high, ends[1] - 1e-6 * u)
        out.append(Spread(parameter, float(u), float(low), float(high)))
    if missing:
        raise InputError(
            f"parameter {', '.join(missing)}: no declared uncertainty; give one, in its own unit, or leave it out"
        )
    if given:
        raise InputError(f"uncertainty of {', '.join(given)}: not among the parameters")
    return out
