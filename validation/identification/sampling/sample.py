"""Draws of what an identification knows: sampled in the directions that the strokes tell, where profiles are curved.

Conventions: z in prior standard uncertainties. Directions of the fit's covariance in which less than half of the
prior's u is left are sampled, at most `MOST_DIRECTIONS`; along the others z is drawn from the linear model, and the
density is taken where they are most probable. The density is the fit's: sizes of noise as learnt, so that draws have
neither the Student factor nor the widening that stated intervals have (docs/explanation/identification.md).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from validation.conventions import Array
from validation.errors import ValidationInputError
from validation.identification.fit import Fitted
from validation.identification.identifiability import HALF
from validation.identification.outcome.result import Identification
from validation.identification.problem import Problem, residuals_there
from validation.identification.sampling.chains import Chains, sample
from validation.identification.sampling.curved import curved
from validation.identification.scatter import factors
from validation.prediction.principal_axes import principal_axes

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
    >>> found = validation.identify(["sessions/example_forte"], ["hammer.joint_friction"], fixed=("*",), profiles=())
    >>> validation.sample_posterior(found).z.shape
    (4, 250, 4)
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
    return _draws(z, chains, bent)


def _draws(z: Array, chains: Chains, bent: list[str]) -> Draws:
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
