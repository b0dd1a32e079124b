"""Errors that all points of a loading experiment share widen the uncertainty by what they do to the fit."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from model import InputError
from model.calibration import damping_factor, fit_felt, read_curve

STIFFNESS = 2e4
DEPTH = 1e-3


def write(path: Path, **columns: np.ndarray) -> Path:
    x = np.concatenate([np.linspace(0.0, DEPTH, 40), np.linspace(DEPTH, 0.0, 40)])
    rng = np.random.default_rng(3)
    f = STIFFNESS * x * np.where(np.arange(80) < 40, 1.05, 0.95) + rng.normal(0.0, 1e-3, 80)
    table = {"displacement_m": x, "force_n": f, **columns}
    rows = [",".join(table), *(",".join(f"{v:.9g}" for v in row) for row in zip(*table.values(), strict=True))]
    path.write_text("\n".join(rows) + "\n", encoding="utf-8")
    return path


def shape() -> np.ndarray:
    return np.concatenate([np.linspace(0.0, 1.0, 40), np.linspace(1.0, 0.0, 40)])


def test_a_compliance_enters_the_stiffness_as_it_should(tmp_path: Path) -> None:
    u_compliance = 2e-6  # m/N: force rises to 20 N, so that 40 um of 1 mm are in doubt
    plain = fit_felt(read_curve(write(tmp_path / "plain.csv")))
    moved = -u_compliance * STIFFNESS * DEPTH * shape()
    fit = fit_felt(read_curve(write(tmp_path / "felt.csv", common_compliance_m=moved)))
    assert fit.abc == pytest.approx(plain.abc)
    # k = f / (x - C f): dk = k^2 dC, taken at a full standard uncertainty
    assert fit.u_abc[2] == pytest.approx(STIFFNESS**2 * u_compliance, rel=0.05)
    assert plain.u_abc[2] < 0.1 * fit.u_abc[2]


def test_a_gain_leaves_the_damping_alone_and_a_phase_dependent_error_does_not(tmp_path: Path) -> None:
    sense = np.where(np.arange(80) < 40, 1.0, -1.0)
    force = STIFFNESS * DEPTH * shape() * (1.0 + 0.05 * sense)
    plain = damping_factor(fit_felt(read_curve(write(tmp_path / "plain.csv"))), 0.05)
    gain = damping_factor(fit_felt(read_curve(write(tmp_path / "gain.csv", common_gain_n=0.01 * force))), 0.05)
    delay = damping_factor(fit_felt(read_curve(write(tmp_path / "d.csv", common_delay_n=0.01 * force * sense))), 0.05)
    assert gain.u_d == pytest.approx(plain.u_d, rel=0.05)
    assert delay.u_d == pytest.approx(0.01 / 0.05, rel=0.05)


def test_two_columns_of_one_name_are_one_error(tmp_path: Path) -> None:
    # displacement and force off by the same share: the stiffness of a linear felt does not notice
    x, f = DEPTH * shape(), STIFFNESS * DEPTH * shape()
    both = read_curve(write(tmp_path / "one.csv", common_scale_m=0.02 * x, common_scale_n=0.02 * f))
    assert list(both.common) == ["scale"]
    apart = read_curve(write(tmp_path / "two.csv", common_length_m=0.02 * x, common_gain_n=0.02 * f))
    assert fit_felt(both).u_abc[2] < 0.1 * fit_felt(apart).u_abc[2]


@pytest.mark.parametrize("column", ["common_zero", "common_zero_kg", "common__m"])
def test_a_column_without_unit_is_refused_by_name(tmp_path: Path, column: str) -> None:
    with pytest.raises(InputError, match=rf"column found {column}; allowed common_<name>_m and common_<name>_n"):
        read_curve(write(tmp_path / "felt.csv", **{column: shape()}))
