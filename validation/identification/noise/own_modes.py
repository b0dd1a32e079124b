"""What each trial most probably has of its own: where the linear model puts it, and how well a run there agrees.

Given z and all that trials share, trials are independent: the cost of one is twice the negative log density of its
residual and of what it has of its own, but for a constant. Source: Lindstrom and Bates (1990), penalised least squares.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from scipy.linalg import cho_solve, cholesky, solve_triangular

from validation.conventions import Array
from validation.identification.noise.marginal import Marginal
from validation.identification.noise.parts import law_columns
from validation.identification.runs.own import Own


class OwnModes:
    """What trials have of their own at values z.

    Parameters
    ----------
    marginal : Marginal
    residuals : at z = 0 of the linear model, of each trial, as if none had anything of its own
    z : (p,)

    Attributes
    ----------
    most : most probable of each trial, by the linear model
    """

    def __init__(self, marginal: Marginal, residuals: Sequence[Array], z: Array) -> None:
        self.marginal, p = marginal, marginal.p
        there = [r - b.moved @ z for r, b in zip(residuals, marginal.blocks, strict=True)]
        rest = np.zeros(marginal.q)
        rest[p:] = cho_solve(marginal.rest, marginal.projected(there)[0][p:])
        self.scatter = marginal.sizes.scatter
        self.shared: list[Array] = []
        self.most: list[Own] = []
        for (lower, x), b, r in zip(marginal.white, marginal.blocks, there, strict=True):
            mine = x @ rest[marginal.columns_of(b.session)]
            pull = solve_triangular(lower, solve_triangular(lower, r, lower=True) - mine, lower=True, trans=1)
            self.shared.append(lower @ mine)
            laws = self.scatter**2 * (np.hstack([b.moved, b.held]).T @ pull)
            self.most.append(Own(laws, b.own[:, : b.driven].T @ pull))

    def costs(self, residuals: Sequence[Array], own: Sequence[Own]) -> Array:
        """Cost (trials,) of residuals of runs at z with what trials have of their own."""
        scatters, out = self.scatter > 0.0, []
        for lower, shared, r, o in zip(self._alone, self.shared, residuals, own, strict=True):
            white = solve_triangular(lower, r - shared, lower=True)
            prior = o.laws[scatters] / self.scatter[scatters]
            out.append(float(white @ white + prior @ prior + o.drive @ o.drive))
        return np.array(out)

    @cached_property
    def _alone(self) -> list[Array]:
        """Root of the covariance of each trial's residual, given what it has of its own."""
        size, out = np.exp(self.marginal.sizes.log()), []
        for b, part in zip(self.marginal.blocks, self.marginal.parts[1], strict=True):
            laws = law_columns(b, self.marginal.sizes).shape[1]
            wander = part.columns[:, laws:] * size[part.place[laws:]]
            film = b.own[:, b.driven :]
            out.append(cholesky(np.diag(b.white) + wander @ wander.T + film @ film.T, lower=True))
        return out
