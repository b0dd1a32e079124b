"""Draws as a file of netCDF groups, as ArviZ names them: posterior, sample_stats, prior, observed_data.

Conventions: each group has its own dimension scales, so that ArviZ and xarray open it without any of ours; values of
the asked parameters are SI or factors, ``z`` holds everything that moved in prior standard uncertainties.
"""

from __future__ import annotations

import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from validation.conventions import ENCODER_CHANNELS, Array
from validation.identification.outcome.result import Identification
from validation.identification.outcome.target_file import check_target
from validation.identification.sampling.sample import CHAINS, DRAWS, SEED, Draws
from validation.report.files import write_files

LIBRARY = "piano-action-rig"


def posterior_netcdf(found: Identification, draws: Draws) -> bytes:
    """The bytes of the file."""
    problem = found.details.problem
    asked, moved = problem.unknowns.asked, problem.unknowns.moved
    prior_z = np.random.default_rng(SEED + 1).standard_normal((CHAINS, DRAWS, len(moved)))
    about = {
        "inference_library": LIBRARY,
        "created_at": str(found.provenance["created_utc"]),
        "warnings": "\n".join(found.warnings),
    }
    how = "model runs" if draws.sampled else "linear model: no profile is curved, or none was made"
    buffer = io.BytesIO()
    with h5py.File(buffer, "w", track_order=True) as file:
        file.attrs.update(about)
        for name, z in (("posterior", draws.z), ("prior", prior_z)):
            group = file.create_group(name, track_order=True)
            group.attrs.update(about | ({"drawn_from": how} if name == "posterior" else {}))
            scales(group, {"chain": np.arange(z.shape[0]), "draw": np.arange(z.shape[1])})
            scales(group, {"parameter": np.array([p.name for p in moved], dtype=h5py.string_dtype())})
            for j, p in enumerate(asked):
                values = np.vectorize(lambda at, p=p: p.physical(problem.action, at))(z[:, :, j])
                put(group, p.name, values, ("chain", "draw"), {"units": p.unit(problem.action)})
            words = "prior standard uncertainties from the value before"
            put(group, "z", z, ("chain", "draw", "parameter"), {"units": "1", "long_name": words})
        stats = file.create_group("sample_stats", track_order=True)
        stats.attrs.update(about | {"acceptance_rate": draws.accepted, "largest_r_hat": draws.r_hat})
        stats.attrs.update({"directions_sampled": draws.directions, "mixed": int(draws.mixed)})
        scales(stats, {"chain": np.arange(draws.z.shape[0]), "draw": np.arange(draws.z.shape[1])})
        put(
            stats,
            "lp",
            draws.log_density,
            ("chain", "draw"),
            {"long_name": "log posterior density, but for a constant"},
        )
        _observed(file.create_group("observed_data", track_order=True), found)
    return buffer.getvalue()


def write_posterior(found: Identification, draws: Draws, path: str | Path) -> Path:
    """Write draws as netCDF groups that ArviZ and xarray open.

    Parameters
    ----------
    found : Identification
    draws : Draws
        Of `validation.sample_posterior`.
    path : path
        File to write, ending in .nc.

    Returns
    -------
    Path

    Raises
    ------
    ValidationInputError
        Another ending, or a folder that is not there or cannot be written; nothing is left half-written.

    Examples
    --------
    >>> import validation
    >>> found = validation.identify(["sessions/example_forte"], ["hammer.joint_friction"], fixed=("*",), profiles=())
    >>> draws = validation.sample_posterior(found)
    >>> validation.write_posterior(found, draws, "posterior.nc").name
    'posterior.nc'
    """
    target = check_target(path, ".nc")
    write_files(target.parent, {target.name: posterior_netcdf(found, draws)})
    return target


def _observed(group: h5py.Group, found: Identification) -> None:
    """Angles of all trials, by session."""
    trials = found.details.problem.trials
    scales(group, {"channel": np.array(ENCODER_CHANNELS, dtype=h5py.string_dtype())})
    for session in sorted({t.session for t in trials}):
        own = [t for t in trials if t.session == session]
        trial, phase = f"trial_{session + 1}", f"phase_{session + 1}"
        labels = np.array([t.label for t in own], dtype=h5py.string_dtype())
        scales(group, {trial: labels, phase: np.arange(own[0].time_s.size)})
        angles = np.array([t.change_rad for t in own])
        words = {"units": "rad", "long_name": "angle since rest, at the phases that were compared"}
        put(group, f"angle_{session + 1}", angles, (trial, phase, "channel"), words)
        times = np.array([t.time_s for t in own])
        put(group, f"time_{session + 1}", times, (trial, phase), {"units": "s", "long_name": "time of the phases"})


def scales(group: h5py.Group, named: Mapping[str, NDArray[Any]]) -> None:
    """Dimension scales of a group."""
    for name, values in named.items():
        group.create_dataset(name, data=values).make_scale(name)


def put(group: h5py.Group, name: str, values: Array, dimensions: tuple[str, ...], words: Mapping[str, str]) -> None:
    """A variable with its dimensions."""
    data = group.create_dataset(name, data=values)
    data.attrs.update(words)
    for i, dimension in enumerate(dimensions):
        data.dims[i].attach_scale(group[dimension])
