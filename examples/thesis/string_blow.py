"""The hammer of an action on a string in place of the thesis's rigid bar, one blow at a time.

The string is stiff, lossy and pinned; its modes swing under the hammer's felt, and the modes beyond them give way as a
spring. Modes swing exactly between the pushes of the felt, one in each step (Strang splitting). Numbers of the C4 of a
grand: A. Chaigne and A. Askenfelt, J. Acoust. Soc. Am. 95 (1994) 1112; losses: J. Bensa et al., J. Acoust. Soc. Am. 114
(2003) 1095.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

import model

Array = NDArray[np.float64]

SHARES = (0.25, 0.5, 1.0, 2.0)  # of the blow's own speed
CHOIR_CENTS = (-0.5, 0.0, 0.5)
HIGHEST_HZ = 5000.0  # of the partials whose slope is fitted
MODES, SOFT_MODES = 64, 20_000
SECONDS = 0.02
STEP_S = 1e-6
ITERATIONS = 12  # Newton's, of the depth, each with the rate in the middle of the push


@dataclass(frozen=True)
class String:
    """Length m, mass kg, tension N, stiffness (bending over tension times length squared), losses, hammer's place."""

    length_m: float
    mass_kg: float
    tension_n: float
    stiffness: float
    b1_per_s: float
    b2_m2_per_s: float
    struck_at: float

    def modes(self, n: Array) -> tuple[Array, Array, Array]:
        """Angular frequencies rad/s, decay rates 1/s and shapes at the hammer of modes n, counted from 1."""
        first = math.pi / self.length_m * math.sqrt(self.tension_n * self.length_m / self.mass_kg)
        omega = n * first * np.sqrt(1.0 + math.pi**2 * self.stiffness * n**2)
        decay = self.b1_per_s + self.b2_m2_per_s * (n * math.pi / self.length_m) ** 2
        return omega, decay, np.sin(n * math.pi * self.struck_at)


@dataclass(frozen=True)
class Hammer:
    """Mass at the string, kg, and felt (a x^3 + b x^2 + c x + k x^p) max(0, 1 + d dx/dt), N."""

    mass_kg: float
    a: float = 0.0
    b: float = 0.0
    c: float = 0.0
    d: float = 0.0
    k: float = 0.0
    p: float = 2.5


C4 = String(0.62, 3.934e-3, 670.0, 3.82e-5, 1.1, 2.7e-4, 0.12)
C4_HAMMER = Hammer(2.97e-3, k=4.5e9, p=2.5)


@dataclass(frozen=True)
class Strike:
    """A blow: times (m,) from first touch, felt's force on all strings (m,), hammer's speed before and after."""

    time_s: Array
    force_n: Array
    before_m_per_s: float
    after_m_per_s: float
    omega_rad_per_s: Array
    amplitude_m_per_s: Array  # (k,) of the first string

    @property
    def contact_s(self) -> float:
        """From first touch to last parting, s."""
        return float(np.ptp(self.time_s[self.force_n > 0.0]))

    @property
    def n_contacts(self) -> int:
        """How often the hammer touches the string."""
        touching = np.concatenate([[False], self.force_n > 0.0])
        return int(np.count_nonzero(touching[1:] & ~touching[:-1]))

    @property
    def rebound(self) -> float:
        """Hammer's speed away from the string after the blow over that before."""
        return -self.after_m_per_s / self.before_m_per_s

    @property
    def slope_db_per_octave(self) -> float:
        """Slope of the partials' velocity amplitudes up to 5 kHz."""
        kept = (self.omega_rad_per_s <= 2.0 * math.pi * HIGHEST_HZ) & (self.amplitude_m_per_s > 0.0)
        level = 20.0 * np.log10(self.amplitude_m_per_s[kept])
        return float(np.polyfit(np.log2(self.omega_rad_per_s[kept]), level, 1)[0])


@njit
def _push(felt, share, away, rate, give, ease):  # type: ignore[no-untyped-def]
    """Force of a share of the felt where it and the string are ``away`` from touch, m, with a closing rate, m/s.

    The depth is less by what the modes left out give, m/N, the rate by half of what the push takes from it, ease m/s/N.
    """
    a, b, c, d, k, p = felt
    force = 0.0
    for _ in range(ITERATIONS):
        x = away - give * force
        faster = 1.0 + d * (rate - ease * force)
        if x <= 0.0 or faster <= 0.0:
            push, slope = 0.0, 0.0
        else:
            curve = share * (((a * x + b) * x + c) * x + k * x**p)
            stiffness = share * ((3.0 * a * x + 2.0 * b) * x + c + p * k * x ** (p - 1.0))
            push, slope = curve * faster, stiffness * faster * give + curve * d * ease
        force = max(0.0, force - (force - push) / (1.0 + slope))
    return force


@njit
def _play(swing, shape, gain, give, felt, mass, step, way, speed, out):  # type: ignore[no-untyped-def]  # noqa: PLR0913
    """Fill ``out`` (m, 2) with the force in the middle of each step and the hammer's speed after it.

    ``swing`` (s, k, 4): what a mode's way and speed become in half a step; ``gain`` 1/kg; ways, speeds (s, k) change.
    """
    strings, modes = way.shape
    hammer_m, hammer_v, share = 0.0, out[0, 1], 1.0 / strings
    for m in range(out.shape[0]):
        total = 0.0
        hammer_m += 0.5 * step * hammer_v
        for i in range(strings):
            away, rate, ease = hammer_m, hammer_v, 0.5 * step / mass
            for n in range(modes):
                q, v = way[i, n], speed[i, n]
                way[i, n] = swing[i, n, 0] * q + swing[i, n, 1] * v
                speed[i, n] = swing[i, n, 2] * q + swing[i, n, 3] * v
                away -= shape[n] * way[i, n]
                rate -= shape[n] * speed[i, n]
                ease += 0.5 * step * gain * shape[n] ** 2
            force = _push(felt, share, away, rate, give, ease)
            for n in range(modes):
                v = speed[i, n] + step * gain * shape[n] * force
                q = way[i, n]
                way[i, n] = swing[i, n, 0] * q + swing[i, n, 1] * v
                speed[i, n] = swing[i, n, 2] * q + swing[i, n, 3] * v
            total += force
        hammer_v -= step * total / mass
        hammer_m += 0.5 * step * hammer_v
        out[m] = total, hammer_v


def strike(
    string: String | None,
    hammer: Hammer,
    speed_m_per_s: float,
    cents: tuple[float, ...] = (0.0,),
    modes: int = MODES,
    seconds: float = SECONDS,
) -> Strike:
    """Let a hammer strike a string, or a choir of strings mistuned by ``cents``, each under its share of the felt.

    None in place of a string is a bar that does not give.
    """
    n = np.arange(1.0, modes + 1.0)
    if string is None:
        omega, swing, shape = np.empty((1, 0)), np.empty((1, 0, 4)), np.empty(0)
        decay, gain, give = omega, 0.0, 0.0
    else:
        strings = [replace(string, tension_n=string.tension_n * 2.0 ** (x / 600.0)) for x in cents]
        omega, decay = (np.stack(part) for part in zip(*(s.modes(n)[:2] for s in strings), strict=True))
        root, half = np.sqrt(omega**2 - decay**2), 0.5 * STEP_S
        c, s = np.exp(-decay * half) * np.cos(root * half), np.exp(-decay * half) * np.sin(root * half) / root
        swing = np.stack([c + decay * s, s, -(omega**2) * s, c - decay * s], axis=2)
        shape, gain = string.modes(n)[2], 2.0 / string.mass_kg
        omega_left, _, shape_left = string.modes(np.arange(modes + 1.0, SOFT_MODES))
        give = float(np.sum(gain * shape_left**2 / omega_left**2))
    way, speed = np.zeros(omega.shape), np.zeros(omega.shape)
    out = np.zeros((round(seconds / STEP_S), 2))
    out[0, 1] = speed_m_per_s
    felt = (hammer.a, hammer.b, hammer.c, hammer.d, hammer.k, hammer.p)
    _play(swing, shape, gain, give, felt, hammer.mass_kg, STEP_S, way, speed, out)
    if out[-1, 0] > 0.0:
        raise SystemExit(f"string: the hammer is still on it after {seconds:g} s; allow more seconds")
    amplitude = np.empty(0)
    if string is not None:
        amplitude = omega[0] * np.hypot(way[0], (speed[0] + decay[0] * way[0]) / root[0])
        amplitude = np.where(np.abs(shape) > 0.1, amplitude, 0.0)
    times = STEP_S * (np.arange(len(out)) + 0.5)
    return Strike(times, out[:, 0], speed_m_per_s, float(out[-1, 1]), omega[0], amplitude)


def hammer_at_the_string(action: model.Action, time_s: Array, force_n: Array) -> tuple[Hammer, float]:
    """Mass of the action's hammer at the string with the felt of contact 12, and its speed, m/s, at first touch."""
    blow = model.simulate(action, time_s, force_n)
    met = np.flatnonzero(blow.hammer_height_m < 0.0)
    if not len(met):
        raise SystemExit("string: the hammer does not reach it under this force; allowed a blow that strikes")
    approach, turning = blow.hammer_approach_m_per_s, blow.speed_rad_per_s[:, blow.bodies.index("hammer")]
    lever, speed = abs(approach[met[0]] / turning[met[0]]), float(approach[met[0] - 1])
    x, y = action["hammer.center_of_mass.x"], action["hammer.center_of_mass.y"]
    inertia = action["hammer.inertia"] + action["hammer.mass"] * (x * x + y * y)
    felt = [action[f"contact12.normal.{name}"] for name in ("a", "b", "c", "D")]
    return Hammer(inertia / lever**2, *felt), speed


def run(action: model.Action, time_s: Array, force_n: Array) -> tuple[list[str], dict[str, Any]]:
    """Bar, string and choir under the action's own hammer, then the whole action on bar and string."""
    hammer, speed = hammer_at_the_string(action, time_s, force_n)
    rows: list[dict[str, Any]] = []
    for v in (share * speed for share in SHARES):
        blows = {
            "bar": strike(None, hammer, v),
            "string": strike(C4, hammer, v),
            "choir": strike(C4, hammer, v, CHOIR_CENTS),
        }
        for name, blow in blows.items():
            slope = blow.slope_db_per_octave if name != "bar" else math.nan
            rows.append(
                {
                    "against": name, "m_per_s": v, "contact_ms": 1e3 * blow.contact_s, "touches": blow.n_contacts,
                    "peak_n": float(blow.force_n.max()), "rebound": blow.rebound, "db_per_octave": slope,
                }
            )  # fmt: skip
    lines = [
        f"String: hammer of {1e3 * hammer.mass_kg:.3g} g at the string, {speed:.3g} m/s under this force; bar as in",
        "the thesis, one C4 string, a choir of three half a cent apart, with the felt of contact12",
        f"{'':<8}{'m/s':>8}{'contact ms':>12}{'touches':>9}{'peak N':>9}{'rebound':>9}{'dB/octave':>11}",
    ]
    for row in rows:
        slope = "-" if row["against"] == "bar" else f"{row['db_per_octave']:.1f}"
        lines.append(f"{row['against']:<8}{row['m_per_s']:>8.3g}{row['contact_ms']:>12.2f}{row['touches']:>9}"
                     f"{row['peak_n']:>9.3g}{row['rebound']:>9.3f}{slope:>11}")  # fmt: skip
    inside = []
    for name, scene in (("bar", "whole"), ("string", "string")):
        at = model.output_times(float(time_s[0]), float(time_s[-1]), 20_000.0)
        moved = model.simulate(
            action, time_s, force_n, scene=scene, output_time_s=at, tolerance=1e-6, contact_forces=True
        )
        blow_marks = model.study.measure_blow(action, moved, np.interp(at, time_s, force_n))
        assert moved.contact_normal_n is not None
        near = moved.contact_normal_n[:, moved.contacts.index("contact12")] > 0.0
        near &= (at > blow_marks.strike_s - 5e-4) & (at < blow_marks.strike_s + 0.01)
        after = moved.hammer_approach_m_per_s[int(np.flatnonzero(near)[-1]) + 1]
        inside.append({"on": name, "contact_ms": 1e3 * float(np.ptp(at[near])), "check_mm": 1e3 * blow_marks.hold_m,
                       "rebound": float(-after / blow_marks.strike_m_per_s)})  # fmt: skip
    lines += ["the whole action under this force:"]
    for row in inside:
        contact, rebound = f"contact {row['contact_ms']:.2f} ms", f"rebound {row['rebound']:.3f}"
        lines.append(f"{row['on']:<8}{contact}, {rebound}, check {row['check_mm']:.2f} mm")
    return lines, {"blows": rows, "in_the_action": inside}
