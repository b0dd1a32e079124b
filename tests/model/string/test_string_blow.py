"""A blow on a string of modes against finite differences, an endless string, conserved energy and published trends."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from model.errors import InputError, IntegrationError
from model.kernels.string_contact import fill_propagators
from model.string import C4, C4_HAMMER, Hammer, String, strike
from model.string.blow import _march

Array = NDArray[np.float64]
MODES = 8


def finite_differences(string: String, hammer: Hammer, speed: float, times: Array, points: int) -> tuple[Array, Array]:
    """Force (m,) and mode displacements (m, MODES) of a string on a grid, fourth order in space.

    The hammer acts on the string through the same band of modes, so both are compared at equal bandwidth.
    """
    h = string.length_m / points
    x = h * np.arange(1, points)
    second = np.zeros((points - 1, points - 1))
    for offset, weight in ((-2, -1.0), (-1, 16.0), (0, -30.0), (1, 16.0), (2, -1.0)):
        for i in range(points - 1):
            j, sign = i + offset, 1.0
            if j < 0:
                j, sign = -j - 2, -1.0  # pinned: odd about the end
            elif j > points - 2:
                j, sign = 2 * (points - 1) - j, -1.0
            if 0 <= j <= points - 2:
                second[i, j] += sign * weight / (12.0 * h * h)
    density = string.mass_kg / string.length_m
    c2 = string.tension_n / density
    stiff = c2 * string.length_m**2 * string.stiffness
    n = np.arange(1, MODES + 1)
    shapes = np.sin(np.outer(n, x) * math.pi / string.length_m)
    spread = (2.0 / string.length_m) * string.shape(n.astype(float)) @ shapes
    fourth = second @ second

    def force(y: Array, hammer_m: float) -> float:
        return hammer.k * max(hammer_m - h * float(spread @ y), 0.0) ** hammer.p

    def rate(_: float, state: Array) -> Array:
        y, v, (z, w) = state[: points - 1], state[points - 1 : -2], state[-2:]
        f = force(y, z)
        bend = second @ (c2 * y + 2.0 * string.b2_m2_per_s * v) - stiff * (fourth @ y)
        return np.concatenate([v, bend - 2.0 * string.b1_per_s * v + f / density * spread, [w, -f / hammer.mass_kg]])

    start = np.zeros(2 * points)
    start[-1] = speed
    seen = solve_ivp(rate, (0.0, times[-1]), start, "DOP853", t_eval=times, rtol=1e-9, atol=1e-12).y
    y = seen[: points - 1]
    return np.array([force(y[:, k], seen[-2, k]) for k in range(len(times))]), (2.0 / points) * (shapes @ y).T


def test_against_finite_differences_of_equal_bandwidth(monkeypatch: pytest.MonkeyPatch) -> None:
    # as on the grid: what is left out does not give way
    monkeypatch.setattr("model.string.blow._give_of_the_rest", lambda *_: 0.0)
    string = replace(C4, b1_per_s=5.0, b2_m2_per_s=1e-3)
    blow = strike(string, C4_HAMMER, 2.0, n_modes=MODES, tolerance=2e-6, seconds=0.004)
    some = slice(None, None, (len(blow.time_s) - 1) // 64)
    force, modes = finite_differences(string, C4_HAMMER, 2.0, blow.time_s[some], 240)
    assert np.abs(force - blow.force_n[some, 0]).max() <= 1e-4 * blow.peak_n
    assert np.abs(modes[-1] - blow.mode_m[0]).max() <= 1e-4 * np.abs(blow.mode_m[0]).max()


def test_before_the_first_echo_the_string_is_endless() -> None:
    string = String(2.0, 0.02, 600.0, 0.0, 0.0, 0.0, 0.5)
    hammer = Hammer(0.008, c=3e4)
    impedance = math.sqrt(string.tension_n * string.mass_kg / string.length_m)
    until = string.length_m / math.sqrt(string.tension_n * string.length_m / string.mass_kg)  # there and back

    def rate(_: float, y: Array) -> list[float]:
        f = 3e4 * max(y[0] - y[2], 0.0)
        return [y[1], -f / 0.008, f / (2.0 * impedance)]

    blow = strike(string, hammer, 1.5, tolerance=2e-3, seconds=0.03)
    early = blow.time_s < 0.98 * until
    seen = solve_ivp(rate, (0.0, until), [0.0, 1.5, 0.0], t_eval=blow.time_s[early], rtol=1e-9, atol=1e-13).y
    force = 3e4 * np.maximum(seen[0] - seen[2], 0.0)
    assert np.abs(blow.force_n[early, 0] - force).max() <= 0.01 * force.max()


def test_energy_goes_to_the_string_and_nowhere_else() -> None:
    string = replace(C4, b1_per_s=0.0, b2_m2_per_s=0.0)
    blow = strike(string, C4_HAMMER, 3.0, tolerance=1e-5)
    n = np.arange(1.0, blow.n_modes + 1.0)
    in_string = 0.5 * string.modal_mass_kg * np.sum((string.omega(n) * blow.amplitude_m()[0]) ** 2)
    lost = 0.5 * C4_HAMMER.mass_kg * (blow.hammer_m_per_s[0] ** 2 - blow.hammer_m_per_s[-1] ** 2)
    assert in_string == pytest.approx(lost, rel=2e-4)
    assert blow.rebound == pytest.approx(math.sqrt(1.0 - lost / (0.5 * C4_HAMMER.mass_kg * 9.0)))


def test_three_strings_in_tune_are_one_of_three_times_the_weight() -> None:
    choir = strike(C4, C4_HAMMER, 2.0, (0.0, 0.0, 0.0), tolerance=1e-5)
    heavy = replace(C4, mass_kg=3.0 * C4.mass_kg, tension_n=3.0 * C4.tension_n)
    one = strike(heavy, C4_HAMMER, 2.0, tolerance=1e-5)
    assert choir.peak_n == pytest.approx(one.peak_n, rel=1e-4)
    assert choir.rebound == pytest.approx(one.rebound, rel=1e-4)
    assert choir.force_n[:, 0] == pytest.approx(choir.force_n[:, 2], rel=1e-9)


def test_mistuned_strings_part_after_the_blow() -> None:
    blow = strike(C4, C4_HAMMER, 2.0, (-5.0, 0.0, 5.0), tolerance=1e-4)
    apart = np.abs(blow.mode_m[0, 0] - blow.mode_m[2, 0]) / np.abs(blow.amplitude_m()[:, 0]).max()
    assert 0.001 < apart < 0.3
    assert np.ptp(blow.amplitude_m()[:, 0]) < 0.01 * blow.amplitude_m()[0, 0]


def test_harder_blows_are_shorter_and_brighter() -> None:
    """The trends that E. Askenfelt and A. Chaigne, and S. Birkett after them, report for any one note."""
    blows = [strike(C4, C4_HAMMER, v, tolerance=1e-3) for v in (0.5, 1.0, 2.0, 4.0)]
    assert (np.diff([b.contact_time_s for b in blows]) < 0.0).all()
    assert (np.diff([b.slope_db_per_octave(5000.0) for b in blows]) > 0.0).all()
    assert all(1.5e-3 < b.contact_time_s < 4e-3 for b in blows)


def test_fewer_modes_where_less_is_asked() -> None:
    counts = [strike(C4, C4_HAMMER, 4.0, tolerance=t).n_modes for t in (1e-2, 1e-4)]
    assert counts[0] < counts[1]


def test_halved_steps_converge_at_second_order() -> None:
    errors = []
    exact = strike(C4, C4_HAMMER, 2.0, n_modes=32, tolerance=1e-7).force_n[:, 0]
    for steps in (1024, 2048, 4096):
        marched = _march([C4], C4_HAMMER, 2.0, 32, 0.012, steps)
        assert marched is not None
        force = marched[0][:, 0]
        errors.append(np.abs(force - exact[:: (len(exact) - 1) // steps]).max())
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.4)
    assert np.log2(errors[1] / errors[2]) == pytest.approx(2.0, abs=0.4)


@pytest.mark.parametrize("sigma", [0.0, 30.0, 400.0, 1000.0, 3000.0])
def test_a_mode_is_carried_over_a_step_exactly(sigma: float) -> None:
    omega, push, step, begin, end = 1000.0, 7.0, 2e-3, 3.0, -5.0

    def rate(t: float, y: Array) -> list[float]:
        return [y[1], push * (begin + (end - begin) * t / step) - 2.0 * sigma * y[1] - omega**2 * y[0]]

    rows = np.empty((1, 8))
    fill_propagators(np.array([omega]), np.array([sigma]), np.array([push]), step, rows)
    row = rows[0]
    seen = solve_ivp(rate, (0.0, step), [1e-3, 0.5], "DOP853", rtol=1e-12, atol=1e-15).y[:, -1]
    q = row[0] * 1e-3 + row[1] * 0.5 + row[4] * begin + row[5] * end
    v = row[2] * 1e-3 + row[3] * 0.5 + row[6] * begin + row[7] * end
    assert (q, v) == pytest.approx(tuple(seen), rel=1e-8, abs=1e-12)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: replace(C4, tension_n=-1.0), "tension_n found -1"),
        (lambda: Hammer(0.003), "allowed a felt that presses"),
        (lambda: Hammer(0.0, c=1.0), "mass_kg found 0"),
        (lambda: strike(C4, C4_HAMMER, 0.0), "speed found 0"),
        (lambda: strike(C4, C4_HAMMER, 1.0, ()), "found 0 strings"),
        (lambda: strike(C4, C4_HAMMER, 1.0, n_modes=0), "found 0 modes"),
        (lambda: strike(C4, C4_HAMMER, 1.0, seconds=1e-3), "still on the string after 0.001 s"),
        (lambda: strike(C4, C4_HAMMER, 2.0).slope_db_per_octave(10.0), "0 partials up to 10 Hz"),
    ],
)
def test_what_cannot_be_struck(make: object, words: str) -> None:
    with pytest.raises(InputError, match=words):
        make()  # type: ignore[operator]


def test_a_tolerance_out_of_reach_is_said() -> None:
    with pytest.raises(IntegrationError, match="not converged"):
        strike(C4, C4_HAMMER, 4.0, n_modes=4, tolerance=1e-14)
