"""One blow of a hammer on a string: from first touch until the string has thrown it off for good.

The step is halved until the contact force no longer changes by more than the tolerance, the number of modes doubled
until force and rebound no longer do; both counts are in the result. What is left out gives way as a spring, so that few
modes suffice where high ones only follow. Equations and their limits: docs/explanation/string_and_motor.md.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.arrays import as_numbers
from model.derived.load import kernel_of
from model.errors import InputError, IntegrationError
from model.kernels.string_contact import fill_propagators, march
from model.parameters.string import String as String
from model.parameters.string import check_numbers

FIRST_MODES, MOST_MODES = 16, 1024
MOST_STEPS = 2**19
MOST_STRINGS = 3

Array = NDArray[np.float64]


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


@dataclass(frozen=True)
class Strike:
    """What a blow did.

    Attributes
    ----------
    time_s : (m,) from first touch
    force_n : (m, strings) of the felt on each string
    hammer_m, hammer_m_per_s : (m,) way and speed of the hammer
    contacts : (begin, end), s, of each time the hammer touches any string
    mode_m, mode_m_per_s : (strings, modes) at the last time
    n_modes, n_steps : used
    error : largest change of the force at the last halving, as a share of its peak
    """

    strings: tuple[String, ...]
    time_s: Array
    force_n: Array
    hammer_m: Array
    hammer_m_per_s: Array
    contacts: tuple[tuple[float, float], ...]
    mode_m: Array
    mode_m_per_s: Array
    n_modes: int
    n_steps: int
    error: float

    @property
    def contact_time_s(self) -> float:
        """From first touch to last parting."""
        return self.contacts[-1][1] - self.contacts[0][0]

    @property
    def peak_n(self) -> float:
        """Largest force on all strings together."""
        return float(self.force_n.sum(axis=1).max())

    @property
    def rebound(self) -> float:
        """Hammer's speed after over before the blow; positive away from the string."""
        return float(-self.hammer_m_per_s[-1] / self.hammer_m_per_s[0])

    def amplitude_m(self) -> Array:
        """Amplitude (strings, modes), m, with which each mode swings on after the blow; 0 where it only creeps back."""
        n = np.arange(1.0, self.n_modes + 1.0)
        out = np.empty_like(self.mode_m)
        for i, string in enumerate(self.strings):
            sigma, omega = string.decay(n), string.omega(n)
            q, v = self.mode_m[i], self.mode_m_per_s[i]
            swings = omega > sigma
            root = np.sqrt(np.where(swings, omega**2 - sigma**2, 1.0))
            out[i] = np.where(swings, np.hypot(q, (v + sigma * q) / root), 0.0)
        return out

    def slope_db_per_octave(self, up_to_hz: float) -> float:
        """Slope of the partials' velocity amplitudes over the octaves up to a frequency, by least squares."""
        n = np.arange(1.0, self.n_modes + 1.0)
        omega = self.strings[0].omega(n)
        amplitude = self.amplitude_m()[0]
        keep = (omega <= 2.0 * math.pi * up_to_hz) & (np.abs(self.strings[0].shape(n)) > 0.1) & (amplitude > 0.0)
        if keep.sum() < 3:
            raise InputError(f"spectrum: {keep.sum()} partials up to {up_to_hz:g} Hz, allowed 3 or more")
        level = 20.0 * np.log10(amplitude[keep] * omega[keep])
        return float(np.polyfit(np.log2(omega[keep]), level, 1)[0])


@lru_cache(maxsize=64)  # asked again at every halving of the step
def _give_of_the_rest(string: String, modes: int) -> float:
    """How far the modes that are left out give way to a steady force, m/N."""
    high = np.arange(modes + 1.0, 20.0 * MOST_MODES)
    return float(np.sum(string.shape(high) ** 2 / (string.modal_mass_kg * string.omega(high) ** 2)))


def _march(
    strings: Sequence[String], hammer: Hammer, speed: float, modes: int, seconds: float, steps: int
) -> tuple[Array, Array, Array] | None:
    """Forces (steps + 1, strings), hammer (steps + 1, 2), modes (strings, k, 2); None where the step is too coarse."""
    n, step = np.arange(1.0, modes + 1.0), seconds / steps
    shape, rows = strings[0].shape(n), np.empty((len(strings), modes, 8))
    soft = np.empty(len(strings))
    for i, string in enumerate(strings):
        fill_propagators(string.omega(n), string.decay(n), shape / string.modal_mass_kg, step, rows[i])
        soft[i] = _give_of_the_rest(string, modes)
    force, seen = np.zeros((steps + 1, len(strings))), np.empty((steps + 1, 2))
    # each string of a choir bears its share of the felt
    share = 1.0 / len(strings)
    felt = (hammer.a * share, hammer.b * share, hammer.c * share, hammer.k * share, hammer.p, hammer.d)
    state, seen[0] = np.zeros((len(strings), modes, 2)), (0.0, speed)
    left = march(kernel_of((), "felt"), shape, rows, soft, (*felt, hammer.mass_kg, step), state, force, seen)
    if not (np.isfinite(seen).all() and left <= 1e-6 * (1.0 + float(np.abs(force).max()))):
        return None
    return force, seen, state


class Marched(NamedTuple):
    """A march whose force no longer changes with the step."""

    force: Array
    hammer: Array
    modes: Array
    steps: int
    change: float


def _settled(
    strings: Sequence[String], hammer: Hammer, speed: float, tolerance: float, modes: int, seconds: float
) -> Marched:
    """March in steps halved until the force is converged."""
    steps = 256
    before = _march(strings, hammer, speed, modes, seconds, steps)
    while steps < MOST_STEPS:
        steps *= 2
        now = _march(strings, hammer, speed, modes, seconds, steps)
        if before is None or now is None:
            before = now
            continue
        change = float(np.abs(now[0][::2] - before[0]).max() / now[0].sum(axis=1).max())
        if change <= tolerance:
            return Marched(*now, steps, change)
        before = now
    raise IntegrationError(f"string: not converged to {tolerance:g} in {steps} steps; allow a larger error")


def strike(
    string: String,
    hammer: Hammer,
    speed_m_per_s: float,
    mistuning_cents: ArrayLike = (0.0,),
    tolerance: float = 1e-4,
    seconds: float = 0.012,
    n_modes: int | None = None,
) -> Strike:
    """Let a hammer strike a string, or a choir of two or three.

    Parameters
    ----------
    string : struck
    hammer : mass and felt
    speed_m_per_s : of the hammer at first touch, above 0
    mistuning_cents : of each string of the choir, at most three
    tolerance : of the contact force, as a share of its peak, and of the hammer's rebound
    seconds : followed from first touch; the hammer must have left by then
    n_modes : of the string; by default as many as the tolerance asks for

    Returns
    -------
    Strike

    Raises
    ------
    InputError : a speed or a choir that cannot be, or a hammer still on the string at the end
    IntegrationError : no convergence

    Examples
    --------
    >>> from model import string
    >>> blow = string.strike(string.C4, string.C4_HAMMER, 2.0)
    >>> print(f"{1e3 * blow.contact_time_s:.1f} ms")
    2.1 ms
    """
    if not (math.isfinite(speed_m_per_s) and speed_m_per_s > 0.0):
        raise InputError(f"strike: speed found {speed_m_per_s:g} m/s, allowed above 0")
    choir = as_numbers(mistuning_cents, "strike: mistuning", 1).tolist()
    if not 1 <= len(choir) <= MOST_STRINGS or not np.isfinite(choir).all():
        raise InputError(f"strike: found {len(choir)} strings, allowed 1 to {MOST_STRINGS} with finite cents")
    if n_modes is not None and not 1 <= n_modes <= MOST_MODES:
        raise InputError(f"strike: found {n_modes} modes, allowed 1 to {MOST_MODES}")
    strings = [replace(string, tension_n=string.tension_n * 2.0 ** (cents / 600.0)) for cents in choir]
    modes = FIRST_MODES if n_modes is None else n_modes
    found = _settled(strings, hammer, speed_m_per_s, tolerance, modes, seconds)
    while n_modes is None:
        if modes >= MOST_MODES:
            raise IntegrationError(f"string: not converged to {tolerance:g} with {modes} modes; allow a larger error")
        more = _settled(strings, hammer, speed_m_per_s, tolerance, 2 * modes, seconds)
        away, enough = _difference(found, more), modes
        found, modes = more, 2 * modes
        if away <= tolerance:
            found, modes = _settled(strings, hammer, speed_m_per_s, tolerance, enough, seconds), enough
            break
    force, seen, state = found.force, found.hammer, found.modes
    time_s = np.linspace(0.0, seconds, found.steps + 1)
    touching = force.sum(axis=1) > 0.0
    if touching[-1]:
        raise InputError(f"strike: the hammer is still on the string after {seconds:g} s; follow it longer (seconds)")
    edges = np.flatnonzero(np.diff(np.concatenate([[False], touching, [False]]).astype(int)))
    contacts = tuple((time_s[max(b - 1, 0)], time_s[e]) for b, e in zip(edges[::2], edges[1::2], strict=True))
    return Strike(
        tuple(strings), time_s, force, seen[:, 0], seen[:, 1], contacts,
        state[:, :, 0], state[:, :, 1], modes, found.steps,
        found.change,
    )  # fmt: skip


def _difference(one: Marched, other: Marched) -> float:
    """How far two marches are apart in force, as a share of its peak, or in the hammer's last speed, of its first."""
    steps = min(one.steps, other.steps)
    a, b = (part.force[:: part.steps // steps] for part in (one, other))
    force = float(np.abs(a - b).max() / b.sum(axis=1).max())
    return max(force, abs(float(one.hammer[-1, 1] - other.hammer[-1, 1])) / float(one.hammer[0, 1]))
