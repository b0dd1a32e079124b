"""Force and stored energy of felt along a prescribed press, by each constitutive law with its parameters."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.arrays import as_numbers
from model.codegen.evaluate_observables import evaluate_rows
from model.codegen.load import load_press_kernel
from model.elements.laws.hysteresis import LONGEST_REACH as LONGEST_REACH
from model.elements.laws.known import LAWS as KNOWN
from model.errors import InputError
from model.parameters.string import check_numbers

LAWS = ("hunt-crossley", "stulov", "hysteresis")

Array = NDArray[np.float64]


class Response(NamedTuple):
    """What a felt answers at each sample."""

    force_n: Array
    """(n,) pushing apart, never negative."""
    stored_j: Array
    """(n,) energy that can come back."""


Pressed = tuple[str, int, tuple[float, ...], float, Sequence[float]]
"""A law by name, how many memories it has, its slow curve (a, b, c, or height and exponent), D, its numbers."""


class FeltLaw:
    """A law of felt with its numbers."""

    def _kernel_arguments(self) -> Pressed:
        raise NotImplementedError

    def response(self, time_s: ArrayLike, depth_m: ArrayLike) -> Response:
        """Force (n,), N, never negative, and stored energy (n,), J, along a press with depths ``depth_m`` (n,) at
        increasing times, from a felt at rest.

        Rates are central differences. Between samples a memory that follows the slow curve sees that run straight; one
        that follows the way is exact for any sampling that has its turning points.

        Parameters
        ----------
        time_s, depth_m : (n,) s, increasing, and m

        Returns
        -------
        Response
            Force, N, and stored energy, J, (n,) each.

        Raises
        ------
        InputError : times and depths that cannot be followed

        Examples
        --------
        >>> import model
        >>> felt = model.felt.HuntCrossley(a=0.0, b=0.0, c=1e4, d=0.1)
        >>> felt.response([0.0, 0.1], [0.0, 1e-3]).force_n.round(3).tolist()
        [0.0, 10.01]
        >>> felt = model.felt.Stulov(f0=1e4, p=1.0, epsilon=0.5, tau_s=1e-3)
        >>> felt.response([0.0, 1e-6, 1.0], [0.0, 1e-3, 1e-3]).force_n.round(2).tolist()
        [0.0, 10.0, 5.0]
        >>> felt = model.felt.Hysteresis(a=0.0, b=0.0, c=1e4, beta=(0.2,), eta=(0.25,))
        >>> felt.response([0.0, 1.0, 2.0], [0.0, 1e-3, 5e-4]).force_n.round(3).tolist()
        [0.0, 12.0, 4.125]
        """
        t, x = _check_press(time_s, depth_m)
        law, memories, curve, damping, numbers = self._kernel_arguments()
        kernel = load_press_kernel(KNOWN[law], memories, len(numbers), len(curve) < 3)
        samples, found = np.column_stack([t, x, np.gradient(x, t)]).reshape(1, -1), np.empty((1, 2 * len(t)))
        given = np.array([len(t), *curve, *[0.0] * (3 - len(curve)), damping, *numbers], dtype=float)
        evaluate_rows(kernel, samples, samples, given, found)
        force, stored = found.reshape(-1, 2).T.copy()
        return Response(force, stored)


def _check_press(time_s: ArrayLike, depth_m: ArrayLike) -> tuple[Array, Array]:
    """Check times (n,), which must increase, and depths (n,), and return them as arrays."""
    t, x = as_numbers(time_s, "press: times"), as_numbers(depth_m, "press: depths")
    if t.ndim != 1 or t.shape != x.shape or len(t) < 2:
        raise InputError(
            f"press: found {t.shape} times and {x.shape} depths, allowed two rows of one length, 2 or more"
        )
    if not (np.isfinite(t).all() and np.isfinite(x).all() and (np.diff(t) > 0.0).all()):
        raise InputError("press: allowed finite depths at times that increase")
    return t, x


def _check_cubic(law: str, a: float, b: float, c: float) -> None:
    check_numbers(f"felt law {law}", a=(a, 0.0, math.inf), c=(c, 0.0, math.inf))
    if b < 0.0 and b * b > 3.0 * a * c * (1.0 + 1e-9):
        raise InputError(f"felt law {law}: b found {b:g}, allowed from {-math.sqrt(3.0 * a * c):g} (stiffness from 0)")


@dataclass(frozen=True)
class HuntCrossley(FeltLaw):
    """f(x) (1 + D dx/dt) with f = a x^3 + b x^2 + c x; eqs 2.4 and 2.5.

    Attributes
    ----------
    a, b, c : N/m^3, N/m^2, N/m
    d : damping factor D, s/m
    """

    a: float
    b: float
    c: float
    d: float

    def __post_init__(self) -> None:
        _check_cubic("hunt-crossley", self.a, self.b, self.c)
        check_numbers("felt law hunt-crossley", D=(self.d, 0.0, math.inf))

    def _kernel_arguments(self) -> Pressed:
        return "hunt-crossley", 0, (self.a, self.b, self.c), self.d, ()


@dataclass(frozen=True)
class Stulov(FeltLaw):
    """F0 (u - eps h) of u = x^p with a memory h that follows u: tau0 dh/dt = u - h while the felt is pressed.

    Where the surfaces part, the felt's own surface lags at u = eps h and follows later: the force is zero until the
    other surface catches up. Slow presses see Q0 (u + alpha du/dt), Q0 = F0 (1 - eps), alpha = tau0 eps / (1 - eps).

    Attributes
    ----------
    f0 : N/m^p, of a press too fast for the memory
    p : exponent of the depth
    epsilon : share of the force that fades, 0 to below 1
    tau_s : time in which it fades, s
    """

    f0: float
    p: float
    epsilon: float
    tau_s: float

    def __post_init__(self) -> None:
        largest = 1.0 - 1e-9
        check_numbers(
            "felt law stulov", F0=(self.f0, 0.0, math.inf), p=(self.p, 0.5, 10.0), epsilon=(self.epsilon, 0.0, largest)
        )
        check_numbers("felt law stulov", tau0=(self.tau_s, 1e-12, math.inf))

    def _kernel_arguments(self) -> Pressed:
        return "stulov", 1, (self.f0 * (1.0 - self.epsilon), self.p), 0.0, (self.epsilon, self.tau_s)


@dataclass(frozen=True)
class Hysteresis(FeltLaw):
    """f(x) (1 + sum of beta z) with ``dz = (dx - |dx| z) / (eta x)``: a loop of the same area at any speed.

    Several memories side by side give minor loops of several widths. On the way in from first touch z is 1, and after
    turning at x_m it is 2 (x / x_m)^(1/eta) - 1. A felt that parted has forgotten: it does not recover slowly.

    Attributes
    ----------
    a, b, c : of f = a x^3 + b x^2 + c x, N/m^3, N/m^2, N/m
    beta : half widths of the loops as shares of f, each from 0, together at most 1
    eta : reach of each memory as a share of the depth, above 0 to 0.4
    """

    a: float
    b: float
    c: float
    beta: tuple[float, ...]
    eta: tuple[float, ...]

    def __post_init__(self) -> None:
        """Refuse a felt that pulls or gives energy."""
        for name in ("beta", "eta"):
            object.__setattr__(self, name, tuple(as_numbers(getattr(self, name), f"hysteresis: {name}", 1).tolist()))
        _check_cubic("hysteresis", self.a, self.b, self.c)
        if len(self.beta) != len(self.eta) or not self.beta:
            raise InputError(
                f"felt law hysteresis: found {len(self.beta)} beta and {len(self.eta)} eta, allowed as many, 1 or more"
            )
        for beta, eta in zip(self.beta, self.eta, strict=True):
            check_numbers("felt law hysteresis", beta=(beta, 0.0, 1.0), eta=(eta, 1e-3, LONGEST_REACH))
        check_numbers("felt law hysteresis", **{"sum of beta": (sum(self.beta), 0.0, 1.0)})

    def _kernel_arguments(self) -> Pressed:
        a, b, c = (x * (1.0 + sum(self.beta)) for x in (self.a, self.b, self.c))
        pairs = [x for pair in zip(self.beta, self.eta, strict=True) for x in pair]
        return "hysteresis", len(self.beta), (a, b, c), 0.0, pairs


@dataclass(frozen=True)
class NamedLaw(FeltLaw):
    """A law as a contact follows it, by its name: one of ``LAWS``, or one that `model.add_law` has added.

    Attributes
    ----------
    law : its name
    a, b, c : of the slow loading curve, N/m^3, N/m^2, N/m
    d : damping factor D of a law that has one, s/m
    values : its other numbers by name; those that are missing are as usual
    """

    law: str
    a: float
    b: float
    c: float
    d: float = 0.0
    values: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Refuse a law that is not known, numbers that it does not have, and any outside its range."""
        numbers, label = KNOWN[self.law].numbers, f"felt law {self.law}"
        for name in self.values:
            if name not in numbers:
                raise InputError(f"{label}: found {name}, allowed {', '.join(numbers) or 'no numbers'}")
        whole = {name: self.values.get(name, n.value) for name, n in numbers.items()}
        object.__setattr__(self, "values", whole)
        _check_cubic(self.law, self.a, self.b, self.c)
        check_numbers(label, D=(self.d, 0.0, math.inf), **{k: (whole[k], n.low, n.high) for k, n in numbers.items()})

    def _kernel_arguments(self) -> Pressed:
        curve = (self.a, self.b, self.c)
        memories, numbers = KNOWN[self.law].pack_numbers(f"felt law {self.law}", self.values, curve)
        return self.law, memories, curve, self.d, numbers
