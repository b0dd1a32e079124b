"""What an identification found, as plain records: every parameter with its interval and what may be said of it.

Conventions: ``value`` is SI, or a factor of the printed stiffness where a, b and c move together; ``u`` is the standard
uncertainty of the value; intervals are 95 %. ``z`` and its uncertainty are in prior standard uncertainties.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import model
from model.arrays import ArrayRecord
from validation.conventions import Array
from validation.prediction.posterior import Posterior

if TYPE_CHECKING:
    from validation.identification.outcome.details import Details
    from validation.identification.outcome.held_out import EventScore

IDENTIFIED = "identified"
DOUBTFUL = "not identified: the model lacks more than the parameter does"
NOT_SETTLED = "not identified: the fit did not settle"
TOO_FEW = "not identified: fewer than three trials say nothing of their scatter"
NOT_IDENTIFIABLE = "not identifiable from these strokes"
FITTED = "fitted trials"
AT_BOUND = "at the end of what was allowed"


@dataclass(frozen=True)
class Estimate:
    """One parameter that was asked for.

    Attributes
    ----------
    name : as in `naming`
    unit : of the value
    prior, prior_u : value and relative or SI standard uncertainty before
    basis : where the prior's u comes from
    z, z_u : most probable value and standard uncertainty, in prior standard uncertainties
    value, u : the same in SI or as a factor
    low, high : 95 % interval of the value; by profile where one was made
    profiled : whether the interval is from a profile
    interval : ``two-sided``, ``open above``, ``open below`` or ``open``: what the strokes alone, without the prior, say
    u_jackknife : of z, from leaving out one trial after the other; NaN with fewer than 3
    u_form : part of ``z_u`` that comes from what the model lacks
    verdict : `IDENTIFIED`, or why not: `NOT_IDENTIFIABLE`, `AT_BOUND`, `DOUBTFUL`,
        `NOT_SETTLED`, `TOO_FEW`
    u_strokes : of z, from leaving out one session, which is one kind of stroke, after the other; NaN with one
    """

    name: str
    unit: str
    prior: float
    prior_u: float
    basis: str
    z: float
    z_u: float
    value: float
    u: float
    low: float
    high: float
    profiled: bool
    interval: str
    u_jackknife: float
    u_form: float
    verdict: str
    u_strokes: float = math.nan


@dataclass(frozen=True)
class Combination:
    """A direction among the asked parameters: names with weights (largest 1), and the share of the prior left."""

    weights: Mapping[str, float]
    left: float

    @property
    def words(self) -> str:
        """``a + 0.6 × b − 0.03 × c``."""
        text = ""
        for i, (name, w) in enumerate(self.weights.items()):
            sign = ("−" if w < 0 else "") if i == 0 else (" − " if w < 0 else " + ")
            digits = ".1f" if abs(w) >= 0.095 else ".1g"
            size = "" if abs(abs(w) - 1.0) < 0.05 else f"{abs(w):{digits}} × "
            text += f"{sign}{size}{name}"
        return text


@dataclass(frozen=True)
class Identification(ArrayRecord):
    """What was found.

    Attributes
    ----------
    action : with the most probable values of everything that was asked for
    estimates : one for each asked parameter, in the order asked
    correlation : (n, n) of the asked parameters
    undetermined, determined : directions among the asked parameters
    warnings : sentences, the most important first
    starts : twice the negative log likelihood of every fit that was made, the best first
    scatter : name -> standard deviation from trial to trial, relative
    scores : name of a set of trials -> scores of printed and identified values and of the null model
    events : name of a set of trials that were not fitted -> how their events are met, see `held_out`
    provenance : what it was made from
    posterior : joint uncertainty of everything the fit moved
    details : the fit itself, with the trials
    """

    action: model.Action
    estimates: tuple[Estimate, ...]
    correlation: Array
    undetermined: tuple[Combination, ...]
    determined: tuple[Combination, ...]
    warnings: tuple[str, ...]
    starts: tuple[float, ...]
    scatter: Mapping[str, float]
    scores: Mapping[str, Any]
    events: Mapping[str, Mapping[str, Mapping[str, EventScore]]]
    provenance: Mapping[str, Any]
    posterior: Posterior
    details: Details = field(repr=False, compare=False)
