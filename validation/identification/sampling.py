"""The posterior as draws: sampled where profiles are curved, else of the linear model; a file that ArviZ opens.

Conventions of the file: groups posterior, sample_stats, prior, observed_data, each with its own dimension scales, so
that ArviZ and xarray open it without any of ours; values of the asked parameters are SI or factors, ``z`` holds
everything that moved in prior standard uncertainties.
"""

from __future__ import annotations

import io
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaln, logsumexp

from validation.conventions import ENCODER_CHANNELS, Array
from validation.errors import ValidationInputError
from validation.identification.estimates import Profile
from validation.identification.fit import Fitted
from validation.identification.identifiability import HALF
from validation.identification.problem import Problem, residuals_there
from validation.identification.result import Identification
from validation.identification.scatter import factors
from validation.prediction.posterior import principal_axes
from validation.report.files import check_target, write_files

FREEDOM = 4.0
LEAST_ROUNDS, MOST_ROUNDS, ROUND = 3, 8, 100  # of fitting the proposal, and how many points each
ENOUGH = 0.4  # of a round's points that count: the proposal fits
WIDER = 1.1  # than what was found: a proposal must not be narrower than the density
LEAST_ACCEPTED, MOST_R_HAT = 0.1, 1.05

LogDensity = Callable[[Array], Array]


@dataclass(frozen=True)
class Chains:
    """Draws of some chains.

    Attributes
    ----------
    draws : (chains, draws, k)
    log_density : (chains, draws)
    accepted : share of proposals accepted
    r_hat : (k,) of each component, split chains
    """

    draws: Array
    log_density: Array
    accepted: float
    r_hat: Array

    @property
    def mixed(self) -> bool:
        """Whether the chains have mixed well enough to be used."""
        return self.accepted >= LEAST_ACCEPTED and bool(np.all(self.r_hat <= MOST_R_HAT))


@dataclass(frozen=True)
class _Student:
    """Multivariate Student density."""

    mean: Array
    root: Array

    def draw(self, n: int, rng: np.random.Generator) -> Array:
        normal = rng.standard_normal((n, self.mean.size)) @ self.root.T
        return np.asarray(self.mean + normal / np.sqrt(rng.chisquare(FREEDOM, n) / FREEDOM)[:, None])

    def log_density(self, at: Array) -> Array:
        k = self.mean.size
        w = np.linalg.solve(self.root, (at - self.mean).T)
        head = gammaln(0.5 * (FREEDOM + k)) - gammaln(0.5 * FREEDOM) - np.log(np.diag(self.root)).sum()
        return np.asarray(head - 0.5 * (FREEDOM + k) * np.log1p((w**2).sum(axis=0) / FREEDOM))


def sample(log_density: LogDensity, size: int, chains: int, draws: int, rng: np.random.Generator) -> Chains:
    """Draw from a density.

    All proposals come from one multivariate Student density, so that their runs need not wait for each other; it is
    fitted to the density first, in a few rounds of importance sampling. What is drawn is exact whatever the proposal;
    how well it mixes is told by the share of proposals accepted and by R-hat. Source: Tierney (1994); Cappé and others
    (2004), population Monte Carlo.

    Parameters
    ----------
    log_density : callable
        Log densities (n,) of points (n, size), but for a constant; minus infinity where there is none.
    size : number of components; in units in which the density is near a standard normal one
    chains, draws : how many chains, and draws of each
    rng : numpy.random.Generator
    """
    proposal = _Student(np.zeros(size), np.eye(size))
    for k in range(MOST_ROUNDS):
        at = proposal.draw(ROUND + 10 * size, rng)
        proposal, (start, log_start), counting = _fitted(proposal, at, log_density(at), chains, rng)
        if counting > ENOUGH and k + 1 >= LEAST_ROUNDS:
            break
    flat = proposal.draw(chains * draws, rng)
    log_flat = log_density(flat)
    weight = (log_flat - proposal.log_density(flat)).reshape(chains, draws)
    now, log_now = start, log_start
    weight_now = log_now - proposal.log_density(now)
    points, logs = flat.reshape(chains, draws, size), log_flat.reshape(chains, draws)
    out, out_log, taken = np.empty_like(points), np.empty_like(logs), 0
    for i in range(draws):
        accept = np.log(rng.random(chains)) < weight[:, i] - weight_now
        taken += int(accept.sum())
        now = np.where(accept[:, None], points[:, i], now)
        log_now, weight_now = np.where(accept, logs[:, i], log_now), np.where(accept, weight[:, i], weight_now)
        out[:, i], out_log[:, i] = now, log_now
    return Chains(out, out_log, taken / weight.size, r_hat(out))


def _fitted(
    proposal: _Student, at: Array, log_at: Array, chains: int, rng: np.random.Generator
) -> tuple[_Student, tuple[Array, Array], float]:
    """A proposal fitted to weighted points, points to start chains from, and the share of points that count."""
    weight = log_at - proposal.log_density(at)
    if not np.isfinite(weight).any():
        raise ValueError("sampling: no point of a round has a density; the start is no maximum")
    share = np.exp(weight - logsumexp(weight))
    known = share > 0.0
    mean = share[known] @ at[known]
    off = (at - mean)[known]
    spread = (off * share[known][:, None]).T @ off
    effective = 1.0 / float(np.sum(share**2))
    # few points that count say little of the width: it is mixed with the last one's
    trust = effective / (effective + 2.0 * mean.size)
    spread = trust * spread + (1.0 - trust) * proposal.root @ proposal.root.T
    chosen = rng.choice(len(at), size=chains, p=share)
    fitted = _Student(mean, WIDER * np.linalg.cholesky(spread))
    return fitted, (at[chosen], log_at[chosen]), effective / len(at)


def r_hat(draws: Array) -> Array:
    """R-hat (k,) of split chains (chains, draws, k): 1 where they agree."""
    half = draws.shape[1] // 2
    parts = np.concatenate([draws[:, :half], draws[:, half : 2 * half]])
    within = parts.var(axis=1, ddof=1).mean(axis=0)
    between = parts.mean(axis=1).var(axis=0, ddof=1)
    return np.asarray(np.sqrt((half - 1) / half + between / np.maximum(within, 1e-300)))


LOPSIDED = 0.1  # of the interval's width: how far its middle may be from the most probable value
OFF = 0.2  # of the linear model's interval: how much narrower or wider the profile's may be


def curved(profiles: Sequence[Profile], z: Array, half: Array) -> list[str]:
    """Names of parameters whose profile is curved.

    Parameters
    ----------
    profiles : those that were made
    z : (n,) most probable values, of the same parameters
    half : (n,) half widths of the linear model's 95 % intervals
    """
    found = []
    for p, at, width in zip(profiles, z, half, strict=True):
        below, above = float(at) - p.low, p.high - float(at)
        whole = below + above
        if abs(above - below) > LOPSIDED * whole or abs(0.5 * whole - width) > OFF * width:
            found.append(p.name)
    return found


MOST_DIRECTIONS = 15
CHAINS, DRAWS = 4, 250
SEED = 142
AT_ONCE = 50


@dataclass(frozen=True)
class Draws:
    """Draws of the posterior.

    Attributes
    ----------
    z : (chains, draws, p) of everything that moves
    log_density : (chains, draws), but for a constant
    curved : parameters whose profile is curved
    sampled : whether runs of the model stand behind the draws; else they are of the linear model
    directions : how many were sampled
    accepted : share of proposals accepted
    r_hat : largest R-hat of a sampled direction
    mixed : whether the chains have mixed
    """

    z: Array
    log_density: Array
    curved: tuple[str, ...]
    sampled: bool
    directions: int = 0
    accepted: float = 1.0
    r_hat: float = 1.0
    mixed: bool = True

    def interval(self, j: int) -> tuple[float, float]:
        """Central 95 % of a parameter, z."""
        low, high = np.quantile(self.z[:, :, j], [0.025, 0.975])
        return float(low), float(high)


def sample_posterior(
    found: Identification, always: bool = False, progress: Callable[[str], None] | None = None
) -> Draws:
    """Draw from the posterior of an identification.

    Conventions: z in prior standard uncertainties. Directions of the fit's covariance in which less than half of the
    prior's u is left are sampled, at most `MOST_DIRECTIONS`; along the others z is drawn from the linear model, and the
    density is taken where they are most probable. The density is the fit's: sizes of noise as learnt, so that draws
    have neither the Student factor nor the widening that stated intervals have
    (docs/explanation/identification.md).

    Parameters
    ----------
    found : Identification
    always : bool
        Sample also where no profile is curved, or none was made.
    progress : callable, optional
        Called with a line of text.

    Returns
    -------
    Draws

    Raises
    ------
    ValidationInputError
        The strokes tell no direction, so that there is nothing to sample.

    Examples
    --------
    >>> import validation
    >>> found = validation.identify(["sessions/example_forte"], ["hammer.joint_friction"], profiles=())
    >>> validation.sample_posterior(found).z.shape
    (4, 250, 166)
    """
    problem, fitted = found.details.problem, found.details.fitted
    names = [p.name for p in problem.unknowns.moved]
    bent: list[str] = []
    if found.details.profiles:
        at = [names.index(p.name) for p in found.details.profiles]
        half = factors(fitted)[at] * np.sqrt(np.diag(fitted.covariance)[at])
        bent = curved(found.details.profiles, fitted.z[at], half)
    rng = np.random.default_rng(SEED)
    values, vectors = principal_axes(fitted.covariance)
    width = np.sqrt(np.maximum(values, 0.0))
    free = rng.standard_normal((CHAINS, DRAWS, width.size))
    if not (bent or always):
        z = _inside(problem, fitted.z + (free * width) @ vectors.T)
        return Draws(z, -0.5 * (free**2).sum(axis=2), (), False)
    involved = np.zeros(width.size)
    for name in bent or names[: len(problem.unknowns.asked)]:
        involved = np.maximum(involved, np.abs(vectors[names.index(name)]) * width)
    told = [int(i) for i in np.argsort(-involved, kind="stable") if width[i] <= HALF][:MOST_DIRECTIONS]
    if not told:
        raise ValidationInputError(
            "sampling: the strokes tell no direction of these parameters; record others, or ask for others"
        )
    axes = vectors[:, told] * width[told]
    if progress is not None:
        progress(f"sampling {len(told)} directions, {', '.join(bent) or 'no profile'} curved")
    chains = sample(_density(problem, fitted, axes, progress), len(told), CHAINS, DRAWS, rng)
    free[:, :, told] = 0.0
    z = _inside(problem, fitted.z + chains.draws @ axes.T + (free * width) @ vectors.T)
    most = float(np.max(chains.r_hat))
    return Draws(z, chains.log_density, tuple(bent), True, chains.draws.shape[2], chains.accepted, most, chains.mixed)


def _inside(problem: Problem, z: Array) -> Array:
    low, high = problem.box()
    return np.clip(z, low, high)


def _density(
    problem: Problem, fitted: Fitted, axes: Array, progress: Callable[[str], None] | None
) -> Callable[[Array], Array]:
    """Log density of points along the axes."""
    low, high = problem.box()

    def log_density(points: Array) -> Array:
        z = fitted.z + points @ axes.T
        out = np.full(len(z), -np.inf)
        inside = np.flatnonzero(np.all((z >= low) & (z <= high), axis=1))
        for first in range(0, inside.size, AT_ONCE):
            part = inside[first : first + AT_ONCE]
            those = [z[i] for i in part]
            own = None if fitted.own is None else [fitted.own_at(at) or [] for at in those]
            found = problem.response.curves(those, own)
            for i, curves, o in zip(part, found, len(those) * [None] if own is None else own, strict=True):
                if curves is not None:
                    there = residuals_there(problem, fitted.marginal.blocks, curves, o)
                    out[i] = -0.5 * fitted.marginal.objective(there, z[i])
            if progress is not None:
                progress(f"sampling: {min(first + AT_ONCE, inside.size)} of {inside.size} points of this round")
        return out

    return log_density


def draw_lines(found: Identification, draws: Draws) -> list[str]:
    """Lines on the draws: whether any profile is curved, how they were made, 95 % of the draws of each parameter.

    Parameters
    ----------
    found : Identification
    draws : Draws

    Returns
    -------
    list of str

    Examples
    --------
    >>> import validation
    >>> found = validation.identify(["sessions/example_forte"], ["hammer.joint_friction"], profiles=())
    >>> validation.draw_lines(found, validation.sample_posterior(found))
    ['posterior: no profile was made; its draws are those of the linear model']
    """
    if not draws.sampled:
        why = "no profile is curved" if found.details.profiles else "no profile was made"
        return [f"posterior: {why}; its draws are those of the linear model"]
    bent = f"profiles are curved ({', '.join(draws.curved)})" if draws.curved else "no profile is curved"
    mixed = "" if draws.mixed else "; the chains did NOT mix: do not use them"
    head = (
        f"posterior: {bent}; {draws.directions} directions sampled, {100 * draws.accepted:.0f} % of proposals "
        f"accepted, R-hat {draws.r_hat:.2f}{mixed}"
    )
    problem = found.details.problem
    lines = [head]
    for j, (p, e) in enumerate(zip(problem.unknowns.asked, found.estimates, strict=True)):
        low, high = sorted(p.physical(problem.action, z) for z in draws.interval(j))
        lines.append(
            f"{e.name}: 95 % of the draws {low:.4g} to {high:.4g}, stated interval {e.low:.4g} to {e.high:.4g} "
            "(draws take sizes of noise as known)"
        )
    return lines


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
    >>> found = validation.identify(["sessions/example_forte"], ["hammer.joint_friction"], profiles=())
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
