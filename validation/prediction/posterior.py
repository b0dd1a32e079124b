"""What an identification knows of an action's parameters together: their covariance, and the trials it comes from.

Conventions: everything in prior standard uncertainties, as in `validation.infer.unknowns`: a law moves
by a factor exp(u z), all else by u z in SI. The covariance of z is the identity but for a few directions in which the
strokes said something; those are kept, each with the share of the prior's variance that is left in it. An action file
holds them in its table ``[identification.posterior]`` (docs/explanation/identification.md).
"""

from __future__ import annotations

import json
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

import model
from rig.atomic_write import sha256_of_bytes
from validation.conventions import Array
from validation.errors import ValidationInputError
from validation.measurement.sample_fingerprints import are_same_samples

EQUAL = 1e-6
"""Components of a unit vector closer than this are equal: rounding leaves 1e-12 of a well conditioned covariance."""


def order_by_size(vector: Array) -> NDArray[np.int64]:
    """Indices of components (n,) by magnitude, the largest first; ties keep their order."""
    return np.argsort(-np.round(np.abs(vector) / EQUAL), kind="stable")


def principal_axes(covariance: Array) -> tuple[Array, Array]:
    """Variances (n,), rising, and axes (n, n) in columns, the largest component of each positive.

    Components that differ by rounding alone count as equal, so that names in order of size come in the same order on
    every processor.
    """
    values, axes = np.linalg.eigh(0.5 * (covariance + covariance.T))
    lead = np.array([order_by_size(axis)[0] for axis in axes.T], dtype=np.int64)
    return values, axes * np.sign(axes[lead, np.arange(lead.size)])


TABLE = "posterior"
KNOWN = ("before", "strokes", "black_boxes", "samples")
"""What a file may hold of the fit beside the uncertainty; one made before these were kept does not."""
TRIALS, EARLIER = "trials_sha256", "earlier_sha256"
"""In the provenance: of the trials fitted, and of those that the values it started from were fitted to."""
TOLD = 1e-4  # of the variance of the prior: directions that lost (or gained) less are left out
DIGITS = 7  # of what a file holds: a share of a standard deviation of 1e-6
CUT = 3.0  # standard deviations, as for parameters that are drawn independently


@dataclass(frozen=True)
class Posterior:
    """Joint uncertainty of identified parameters."""

    names: tuple[str, ...]  # (p,) of all parameters that the fit moved
    paths: tuple[tuple[str, ...], ...]  # (p,) parameters of the action that each of them moves together
    u: tuple[float, ...]  # (p,) prior standard uncertainty, relative for a ``factor``, SI otherwise
    factor: tuple[bool, ...]  # (p,) whether it moves by a factor
    directions: Array  # (k, p) orthonormal: combinations of z of which the strokes said something
    left: Array  # (k,) share of the variance of the prior that is left along each
    # label -> SHA-256 of each trial the values were fitted to, in this fit or in those it started from
    trials: Mapping[str, str]
    before: Mapping[str, float] = field(default_factory=dict)  # parameter of the action -> value before the fit, SI
    # label -> what the trials fitted were like, see `validation.statistics.domain`
    strokes: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    # kind -> black box fitted to the same trials, see `validation.prediction.black_boxes`
    black_boxes: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    # label -> fingerprints of the trials' samples, see `validation.measurement.sample_fingerprints`
    samples: Mapping[str, Sequence[str]] = field(default_factory=dict)

    def was_fitted_to(self, seal: str, samples: Collection[str]) -> bool:
        """Whether a trial is one of those fitted: by its file, or by samples that it shares with one."""
        known = seal in set(self.trials.values())
        return known or any(are_same_samples(samples, one) for one in self.samples.values())

    @property
    def covariance(self) -> Array:
        """Of z, (p, p)."""
        return np.eye(len(self.names)) + self.directions.T @ ((self.left - 1.0)[:, None] * self.directions)

    @cached_property
    def moved(self) -> frozenset[str]:
        """Parameters of the action whose uncertainty is in here."""
        return frozenset(path for paths in self.paths for path in paths)

    def draws(self, action: model.Action, n: int, rng: np.random.Generator) -> list[dict[str, float]]:
        """Draw ``n`` sets of values, path -> SI, about those of the action; as correlated as they were found to be."""
        out = []
        for _ in range(n):
            free = np.clip(rng.standard_normal(len(self.names)), -CUT, CUT)
            z = free + self.directions.T @ ((np.sqrt(self.left) - 1.0) * (self.directions @ free))
            drawn: dict[str, float] = {}
            for paths, u, factor, at in zip(self.paths, self.u, self.factor, z, strict=True):
                for path in paths:
                    drawn[path] = float(action[path] * np.exp(u * at) if factor else action[path] + u * at)
            out.append(drawn)
        return out

    def table(self) -> dict[str, Any]:
        """Plain values for the table ``[identification.posterior]`` of an action file: all fields but the trials, which
        its provenance has; directions to seven digits, empty fields left out."""
        return {
            "names": list(self.names),
            "paths": [list(paths) for paths in self.paths],
            "u": list(self.u),
            "factor": list(self.factor),
            "directions": [[float(f"{x:.{DIGITS}g}") for x in row] for row in self.directions],
            "left": [float(f"{x:.{DIGITS}g}") for x in self.left],
            **{name: dict(known) for name in KNOWN if (known := getattr(self, name))},
        }


def make_posterior(
    parameters: Sequence[tuple[str, tuple[str, ...], float, bool]], covariance: Array, trials: Mapping[str, str]
) -> Posterior:
    """Joint uncertainty of fitted parameters, each (name, paths, prior u, whether it moves by a factor), from the
    covariance (p, p) of z: only directions along which it differs from the prior's are kept. ``trials``: label ->
    SHA-256.

    Parameters
    ----------
    parameters : sequence of (name, paths, u, factor), (p,)
    covariance : (p, p) of z
    trials : label -> SHA-256
    """
    values, vectors = principal_axes(covariance)
    told = np.abs(values - 1.0) > TOLD
    names, paths, u, factor = zip(*parameters, strict=True)
    return Posterior(names, paths, u, factor, vectors.T[told], np.maximum(values[told], 0.0), dict(trials))


def posterior_of(action: model.Action) -> Posterior | None:
    """Joint uncertainty that the file of an identified action holds; None where the action was not identified, an input
    error where the table is damaged."""
    table = action.identification.get(TABLE)
    if table is None:
        return None
    where = f"{action.origin}: [identification.{TABLE}]"
    advice = "write the file again with pianorig identify, or take the table out"
    try:
        paths = tuple(tuple(map(str, group)) for group in table["paths"])
        names = tuple(map(str, table["names"]))
        left = np.array(table["left"], dtype=float)
        directions = np.array(table["directions"], dtype=float).reshape(left.size, len(names))
        u, factor = tuple(map(float, table["u"])), tuple(bool(x) for x in table["factor"])
        provenance = action.identification["provenance"]
        trials = dict(provenance[TRIALS])
        kept: dict[str, dict[str, Any]] = {name: dict(table.get(name, {})) for name in KNOWN}
        kept["before"] = {str(path): float(value) for path, value in kept["before"].items()}
        trials |= {f"an earlier fit's trial {k + 1}": str(seal) for k, seal in enumerate(provenance.get(EARLIER, []))}
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise ValidationInputError(f"{where}: found damaged ({error}); {advice}") from None
    if not len(names) == len(paths) == len(u) == len(factor):
        raise ValidationInputError(f"{where}: found lists of different lengths; {advice}")
    if not (np.all(left >= 0.0) and np.all(np.isfinite(left)) and np.all(np.isfinite(directions))):
        raise ValidationInputError(f"{where}: left found below 0 or not finite, allowed from 0; {advice}")
    if not np.allclose(directions @ directions.T, np.eye(left.size), atol=1e-4):  # written with seven digits
        raise ValidationInputError(f"{where}: directions found not orthonormal; {advice}")
    known = model.quantities_of(action)
    for path in (*(path for group in paths for path in group), *kept["before"]):
        if path not in known:
            raise ValidationInputError(f"{where}: parameter {path} is unknown; {advice}")
    return Posterior(names, paths, u, factor, directions, left, trials, **kept)


VALUES_SHA256, ORIGIN_SHA256 = "values_sha256", "origin_sha256"


def digests(action: model.Action, provenance: Mapping[str, Any], posterior: Mapping[str, Any]) -> dict[str, str]:
    """SHA-256 by key: ``values_sha256`` of an identified action's values, ``origin_sha256`` of its trials and
    posterior; ``provenance``, ``posterior``: these tables of its file.

    Parameters
    ----------
    action : with the values that are written
    provenance, posterior : tables of ``[identification]``
    """
    origin = json.dumps([provenance.get(TRIALS), provenance.get(EARLIER, []), posterior], sort_keys=True)
    structure = sorted((path, text) for path, text in action.structure.items() if path != "name")
    return {
        VALUES_SHA256: sha256_of_bytes(f"{action.content()}\n{structure}".encode()),
        ORIGIN_SHA256: sha256_of_bytes(origin.encode()),
    }


def list_alterations(action: model.Action) -> list[str]:
    """Texts on what was changed since the identification, in the file or by override for this run; empty where nothing
    was, or the file has no hashes and no value is overridden.

    They find out edits, not fraud: a hash can be written anew. A file without them is taken as it is.
    """
    table = action.identification
    if VALUES_SHA256 not in table or ORIGIN_SHA256 not in table:
        return [] if not action.changed else [_name_hand_set(action)]
    now = digests(action, table.get("provenance", {}), table.get(TABLE, {}))
    said = []
    if table[ORIGIN_SHA256] != now[ORIGIN_SHA256]:
        said.append(f"what {action.origin} says of its trials or uncertainty was edited after it was written")
    if action.changed:
        said.append(_name_hand_set(action))
    elif table[VALUES_SHA256] != now[VALUES_SHA256]:
        said.append(f"values in {action.origin} were edited after it was written")
    return said


def _name_hand_set(action: model.Action) -> str:
    return f"{', '.join(sorted(action.changed))} set by hand since"
