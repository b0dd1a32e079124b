"""Draws of an identification: curved profiles are sampled by runs, others drawn from the linear model; the file."""

from __future__ import annotations

import io
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import xarray

from tests.validation.identification import toy
from validation.errors import ValidationInputError
from validation.identification.estimates import profiles
from validation.identification.fit import fit
from validation.identification.sampling import CHAINS, DRAWS, curved, posterior_netcdf, sample_posterior
from validation.identification.scatter import factors


@pytest.fixture(scope="module")
def found() -> Any:
    """As much of an identification as draws are made from."""
    p = toy.problem(toy.made(np.array([0.8, -0.5, 0.3]), 5, np.random.default_rng(3), scatter=0.02))
    fitted = fit(p)
    made = tuple(profiles(p, fitted, {j: float(factors(fitted)[j]) for j in range(3)}))
    details = SimpleNamespace(problem=p, fitted=fitted, profiles=made)
    return SimpleNamespace(details=details, provenance={"created_utc": "2026-11-22T00:00:00Z"}, warnings=("one",))


def test_what_is_not_curved_is_drawn_from_the_linear_model(found: Any) -> None:
    draws = sample_posterior(found)
    assert not draws.sampled and draws.curved == ()
    fitted = found.details.fitted
    flat = draws.z.reshape(-1, 3)
    assert flat.mean(axis=0) == pytest.approx(fitted.z, abs=4 * np.sqrt(np.diag(fitted.covariance) / len(flat)).max())
    assert np.cov(flat.T) == pytest.approx(fitted.covariance, rel=0.2, abs=1e-4)


def test_sampling_a_density_that_is_nearly_normal_agrees_with_it(found: Any) -> None:
    lines: list[str] = []
    draws = sample_posterior(found, always=True, progress=lines.append)
    fitted = found.details.fitted
    assert draws.sampled and draws.mixed and draws.directions == 3 and any("sampling 3 directions" in x for x in lines)
    width = np.sqrt(np.diag(fitted.covariance))
    flat = draws.z.reshape(-1, 3)
    assert np.abs(flat.mean(axis=0) - fitted.z).max() < 0.3 * width.max()
    assert flat.std(axis=0) == pytest.approx(width, rel=0.25)
    low, high = draws.interval(0)
    assert low < fitted.z[0] < high


def test_a_lopsided_or_wide_profile_is_curved(found: Any) -> None:
    one = found.details.profiles[0]
    half = np.array([0.1])
    even = SimpleNamespace(name="a", low=-0.1, high=0.1)
    assert curved([even], np.zeros(1), half) == []
    assert curved([SimpleNamespace(name="a", low=-0.05, high=0.15)], np.zeros(1), half) == ["a"]
    assert curved([SimpleNamespace(name="a", low=-0.2, high=0.2)], np.zeros(1), half) == ["a"]
    assert one.name == toy.ASKED[0]


def test_nothing_told_is_refused_in_one_line(found: Any) -> None:
    p = toy.problem(toy.made(np.zeros(3), 3, np.random.default_rng(1)))
    blind = SimpleNamespace(z=np.zeros(3), covariance=np.eye(3), marginal=None)
    nothing = SimpleNamespace(details=SimpleNamespace(problem=p, fitted=blind, profiles=()))
    with pytest.raises(ValidationInputError, match="the strokes tell no direction") as error:
        sample_posterior(nothing, always=True)
    assert "\n" not in str(error.value)


def test_the_file_holds_the_groups_that_arviz_names(found: Any) -> None:
    draws = sample_posterior(found)
    data = posterior_netcdf(found, draws)
    for group, names in (("posterior", toy.ASKED), ("prior", toy.ASKED), ("sample_stats", ("lp",))):
        with xarray.open_dataset(io.BytesIO(data), group=group, engine="h5netcdf") as opened:
            for name in names:
                assert opened[name].dims == ("chain", "draw") and opened[name].shape == (CHAINS, DRAWS)
    with xarray.open_dataset(io.BytesIO(data), group="posterior", engine="h5netcdf") as opened:
        parameter = found.details.problem.unknowns.asked[0]
        expected = parameter.physical(found.details.problem.action, float(draws.z[1, 7, 0]))
        assert float(opened[toy.ASKED[0]][1, 7]) == expected
        assert list(opened["parameter"].values) == list(toy.ASKED)
    with xarray.open_dataset(io.BytesIO(data), group="observed_data", engine="h5netcdf") as opened:
        assert opened["angle_1"].dims == ("trial_1", "phase_1", "channel") and opened["angle_1"].shape[0] == 5
