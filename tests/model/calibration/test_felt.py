"""A known felt is found again, within the stated uncertainty, and never outside what a felt can do."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from model import InputError, load_action
from model.calibration import damping_factor, fit_felt
from model.calibration.curve import LoadingCurve, check_curve

SPEED = 0.11  # m/s, mean normal speed of the imagined blow


def cubic(abc: np.ndarray, x: np.ndarray) -> np.ndarray:
    return abc[0] * x**3 + abc[1] * x**2 + abc[2] * x


def printed(contact: str) -> tuple[np.ndarray, float]:
    action = load_action()
    return np.array([action[f"{contact}.normal.{k}"] for k in "abc"]), action[f"{contact}.normal.D"]


def experiment(
    abc: np.ndarray, d: float, deepest: float, noise: float, rng: np.random.Generator, jitter: float = 0.0
) -> LoadingCurve:
    """Loading above and unloading below the cubic by D times the speed; noise in N, jitter of the displacement in m."""
    x_in, x_out = np.sort(rng.uniform(0, deepest, 130)), np.sort(rng.uniform(0, deepest, 90))[::-1]
    x = np.concatenate([x_in, x_out])
    f = cubic(abc, x) * np.where(np.arange(220) < 130, 1 + d * SPEED, 1 - d * SPEED)
    return check_curve(
        x + rng.normal(0.0, jitter, 220) if jitter else x,
        f + rng.normal(0.0, noise, 220),
        ["loading"] * 130 + ["unloading"] * 90,
    )


def test_noiseless_felt_is_found_to_rounding() -> None:
    abc, d = printed("contact07")
    fit = fit_felt(experiment(abc, d, 6e-4, 0.0, np.random.default_rng(1)))
    assert fit.abc == pytest.approx(abc, rel=1e-9)
    assert fit.bound is None and fit.misfit_n < 1e-9
    assert damping_factor(fit, SPEED).d == pytest.approx(d, rel=1e-9)


def test_stated_uncertainty_equals_actual_error() -> None:
    deepest, (abc, d) = 1e-3, printed("contact02")
    rng = np.random.default_rng(20040521)
    noise = 0.02 * cubic(abc, np.array([deepest]))[0]
    z = []
    for _ in range(300):
        fit = fit_felt(experiment(abc, d, deepest, noise, rng))
        one = damping_factor(fit, SPEED)
        assert fit.bound is None
        z.append([*((fit.abc - abc) / fit.u_abc), (one.d - d) / one.u_d])
    inside = np.mean(np.abs(z) < 1.96, axis=0)
    assert np.all((inside > 0.915) & (inside < 0.99)), inside  # 0.95 +- 2.7 standard errors
    assert np.all(np.abs(np.mean(z, axis=0)) < 0.2)


def test_noise_of_the_displacement_is_seen_in_the_uncertainty() -> None:
    abc, d = printed("contact02")
    rng = np.random.default_rng(3)
    z = []
    for _ in range(200):
        fit = fit_felt(experiment(abc, d, 1e-3, 1e-3, rng, jitter=3e-6))
        z.append((fit.abc - abc) / fit.u_abc)
    assert np.std(z, axis=0) == pytest.approx([1.0, 1.0, 1.0], abs=0.17)


@settings(deadline=None)
@given(
    st.floats(-2.0, 2.0),
    st.floats(-2.0, 2.0),
    st.floats(-2.0, 2.0),
    st.integers(0, 10_000),
)
def test_fit_is_a_felt_whatever_the_curve(p: float, q: float, r: float, seed: int) -> None:
    """Positive, monotone at every depth, and no other such cubic is nearer to the mid-line."""
    deepest = 1e-3
    x = np.linspace(0.0, deepest, 40)
    s = x / deepest
    mid = p * s**3 + q * s**2 + r * s
    if mid[-1] <= 0.05 or mid.max() <= 0.05:
        return
    words = ["loading"] * 40 + ["unloading"] * 40
    curve = check_curve(np.concatenate([x, x[::-1]]), np.concatenate([mid + 0.02 * s, (mid - 0.02 * s)[::-1]]), words)
    try:
        fit = fit_felt(curve)
    except InputError as refused:
        assert "pulls more than it presses" in str(refused)
        return
    depth = np.linspace(0.0, 20 * deepest, 4000)
    a, b, c = fit.abc * deepest ** np.array([3.0, 2.0, 1.0])
    stiffness = 3 * a * (depth / deepest) ** 2 + 2 * b * depth / deepest + c
    assert stiffness.min() > -1e-6 * max(abs(a), abs(b), abs(c))
    rng = np.random.default_rng(seed)
    for _ in range(50):
        other = np.array([a, b, c]) + rng.normal(0.0, 0.05, 3)
        if other[0] >= 0 and other[2] >= 0 and other[1] >= -np.sqrt(3 * other[0] * other[2]):
            away = np.mean((fit.mid_n - np.stack([s_ := fit.mid_m / deepest, s_**2, s_**3])[::-1].T @ other) ** 2)
            assert fit.misfit_n**2 <= away + 1e-9


def test_swapped_phases_have_no_damping() -> None:
    x = np.linspace(0.0, 1e-3, 30)
    f = 2e3 * x
    swapped = check_curve(
        np.concatenate([x, x[::-1]]), np.concatenate([0.8 * f, 1.2 * f[::-1]]), ["loading"] * 30 + ["unloading"] * 30
    )
    with pytest.raises(InputError, match="are the phases swapped"):
        damping_factor(fit_felt(swapped), 0.1)


@pytest.mark.parametrize("speed", [0.0, -0.1, np.nan, np.inf])
def test_speed_must_be_positive(speed: float) -> None:
    abc, d = printed("contact02")
    fit = fit_felt(experiment(abc, d, 1e-3, 0.0, np.random.default_rng(5)))
    with pytest.raises(InputError, match="mean normal speed"):
        damping_factor(fit, speed)


def stulov(p: float, noise: float, rng: np.random.Generator) -> LoadingCurve:
    """A felt with another power than the cubic can take, and memory that closes at the turn."""
    x = np.concatenate([np.linspace(0.0, 1e-3, 150), np.linspace(1e-3, 0.0, 150)])
    s = x / 1e-3
    f = 40.0 * s**p * np.where(np.arange(300) < 150, 1.0, 1.0 - 0.8 * (1.0 - s))
    return check_curve(x, f + rng.normal(0.0, noise, 300), ["loading"] * 150 + ["unloading"] * 150)


@pytest.mark.parametrize("noise", [0.02, 0.2])
def test_a_felt_of_another_law_is_said_and_its_errors_widened(noise: float) -> None:
    fit = fit_felt(stulov(5.0, noise, np.random.default_rng(8)))
    assert not fit.law_fits and not fit.loop_fits
    assert fit.widened == pytest.approx(fit.misfit_n / fit.u_mid_n) and fit.widened > 3.0
    plain = np.sqrt(np.diag(fit.gain * np.concatenate([fit.loading.variance, fit.unloading.variance]) @ fit.gain.T))
    np.testing.assert_allclose(fit.u_abc, fit.widened * plain, rtol=1e-9)
    # the share at which D is read depends on the depth by more than its stated error without widening
    ratio, u = fit.loading_ratio(0.9e-3)
    assert u > fit.loop_misfit_n / 40.0 and ratio > 1.0


@pytest.mark.parametrize(
    ("contact", "deepest", "share"),
    [
        ("contact02", 1e-3, 0.001),
        ("contact13", 4e-4, 0.02),
    ],
)
def test_a_felt_of_the_law_is_hardly_ever_doubted(contact: str, deepest: float, share: float) -> None:
    abc, d = printed(contact)
    rng = np.random.default_rng(77)
    noise = share * cubic(abc, np.array([deepest]))[0]
    fits = [fit_felt(experiment(abc, d, deepest, noise, rng)) for _ in range(200)]
    assert sum(not fit.law_fits for fit in fits) <= 4
    assert sum(not fit.loop_fits for fit in fits) <= 4
