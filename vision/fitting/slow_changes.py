"""Light and scale that change across a body: measured in the residuals of a fit, and taken out of the frame.

Gain and offset follow light that changes everywhere alike. A lamp that moves with the body, a shadow's slow edge, or
bands of a lamp's flicker in a rolling picture multiply the grey values by a factor that grows across the body; a body
that comes nearer is larger, one that tilts is shorter one way. Five groups of terms, each fitted only where the
residuals ask for it, since on weak texture they take information from the pose: the covariance then grows by what they
take.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from vision.fitting.template import Template

GROUPS: dict[str, slice] = {
    "light": slice(0, 2),
    "scale": slice(2, 3),
    "bend": slice(3, 6),
    "stretch": slice(6, 7),
    "shear": slice(7, 8),
}
"""Places of each group's amplitudes: the light's factor along x and y, the scale, the factor along xx, xy and yy, and
the stretch along x less that along y, and along the diagonals; places in units of the body's radius, scale and stretch
as the share by which it has grown."""
N_TERMS = 8
ASKED_FOR = 25.0
"""Chi-squared of a group from which it is believed: one fit in a hundred thousand by chance."""
PERHAPS = 3.0
"""Chi-squared with weights over that without, at most."""
DEAREST = 2.0
"""Factor of the variance of the turn by which a group may be paid for, at most: what can hardly be told from the pose
(a tilt about a diagonal, of a long body or one whose grain runs along it) would follow noise. It is left to the
uncertainty."""
MOST = np.array([0.6, 0.6, 0.05, 0.6, 0.6, 0.6, 0.05, 0.05])
"""Largest amplitudes that are followed."""

Changes = tuple[float, ...]
UNCHANGED: Changes = (0.0,) * N_TERMS
LIGHT, TILT = ("light", "bend"), ("stretch", "shear")
SHAPE = np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 1.0])
"""Terms of the body's shape, not of the light."""


class SlowChanges:
    """The terms of one template."""

    def __init__(self, template: Template) -> None:
        self._template = template
        grey = template.columns[3].astype(float) + template.mean_grey
        dx, dy = template.offset_px.astype(float)
        x, y = dx / template.radius_px, dy / template.radius_px
        # a larger body shows at each place what was nearer to its middle
        scale = -(template.columns[1] * dx + template.columns[2] * dy)
        along = template.columns[2] * dy - template.columns[1] * dx
        across = -(template.columns[1] * dy + template.columns[2] * dx)
        terms = np.stack([grey * x, grey * y, scale, grey * x * x, grey * x * y, grey * y * y, along, across])
        design = np.vstack([template.columns.astype(float), np.ones(template.n_pixels)])
        self._across = terms @ design.T
        # what the five parameters of the fit cannot follow
        follow = np.linalg.lstsq(template.normal, self._across.T, rcond=None)[0]
        self._terms = terms - follow.T @ design
        self._products = terms @ terms.T
        self._inverses = {
            part.start: np.linalg.pinv(own @ own.T) for part in GROUPS.values() for own in [self._terms[part]]
        }
        self._factors: dict[tuple[int, ...], NDArray[np.float64]] = {}

    def variance_factor(self, changes: Changes) -> NDArray[np.float64]:
        """Factor of the variances of (turn, x, y), (3,), for the terms that are in use."""
        rows = _rows_in_use(changes)
        used = tuple(rows.tolist())
        if used not in self._factors:
            normal, across = self._template.normal, self._across[rows]
            whole = np.block([[normal, across.T], [across, self._products[np.ix_(rows, rows)]]])
            scale = 1.0 / np.sqrt(np.maximum(whole.diagonal(), 1e-300))
            with_terms = np.linalg.pinv(whole * scale[:, None] * scale, rcond=1e-9).diagonal()[:3]
            alone = np.linalg.pinv(normal * scale[:5, None] * scale[:5], rcond=1e-9).diagonal()[:3]
            self._factors[used] = np.maximum(with_terms / np.maximum(alone, 1e-300), 1.0)
        return self._factors[used]

    def measure(
        self,
        weight: NDArray[np.float32],
        residual: NDArray[np.float32],
        gain: float,
        noise2: float,
        left_out: tuple[str, ...] = (),
    ) -> Changes:
        """What the residuals of a fit, with their weights, say of the group that explains them best; `UNCHANGED` where
        each may be chance. Names of groups that are ``left_out`` may not."""
        w = weight.astype(float)
        weighted = w * residual
        # sums, not products of matrices, whose order of adding may depend on threads
        right = np.array([float(np.sum(weighted * term)) for term in self._terms])
        best, found = ASKED_FOR, UNCHANGED
        for part in (own for name, own in GROUPS.items() if name not in left_out):
            if PERHAPS * right[part] @ self._inverses[part.start] @ right[part] < best * max(noise2, 1e-9):
                continue  # far too little, whatever the weights
            rows = np.arange(N_TERMS)[part]
            if self.variance_factor(_placed(rows, np.ones(rows.size)))[0] > DEAREST:
                continue
            amplitude = self._solved(rows, w, right)
            if amplitude is not None and (chi2 := float(amplitude @ right[part]) / max(noise2, 1e-9)) > best:
                best, found = chi2, _placed(rows, amplitude / gain)
        return found

    def followed(
        self, weight: NDArray[np.float32], residual: NDArray[np.float32], gain: float, changes: Changes
    ) -> Changes:
        """How the groups in use have changed since ``changes``, by the residuals of a fit; `UNCHANGED` without any."""
        rows = _rows_in_use(changes)
        w = weight.astype(float)
        right = np.zeros(N_TERMS)
        right[rows] = [float(np.sum(w * residual * self._terms[row])) for row in rows]
        amplitude = self._solved(rows, w, right) if rows.size else None
        return UNCHANGED if amplitude is None else _placed(rows, amplitude / gain)

    def _solved(
        self, rows: NDArray[np.intp], w: NDArray[np.float64], right: NDArray[np.float64]
    ) -> NDArray[np.float64] | None:
        """Amplitudes of some of the terms; None where the pixels do not tell them apart."""
        normal = np.empty((rows.size, rows.size))
        for i, one in enumerate(rows):
            weighted = w * self._terms[one]
            for j, other in enumerate(rows[: i + 1]):
                normal[i, j] = normal[j, i] = float(np.sum(weighted * self._terms[other]))
        scale = 1.0 / np.sqrt(np.maximum(normal.diagonal(), 1e-300))
        if np.linalg.eigvalsh(normal * scale[:, None] * scale)[0] < 1e-3:
            return None
        return np.asarray(np.linalg.solve(normal, right[rows]))

    def offset_px(self, changes: Changes) -> NDArray[np.float32]:
        """Places of the template's pixels on a body of another scale and tilt."""
        _, _, scale, _, _, _, along, across = changes
        stretch = np.array([[1.0 + scale + along, across], [across, 1.0 + scale - along]])
        dx, dy = self._template.offset_px.astype(float)
        return np.stack([a * dx + b * dy for a, b in stretch]).astype(np.float32)

    def divided_out(
        self, coefficient: NDArray[np.float32], corner: tuple[int, int], pose: NDArray[np.float64], changes: Changes
    ) -> NDArray[np.float32]:
        """Spline coefficients of a region, whose first pixel is at (y, x), under even light."""
        template = self._template
        cosine, sine = math.cos(pose[0]) / template.radius_px, math.sin(pose[0]) / template.radius_px
        height, width = coefficient.shape
        right = np.arange(corner[1], corner[1] + width) - (template.centre_px[0] + pose[1])
        down = np.arange(corner[0], corner[0] + height) - (template.centre_px[1] + pose[2])
        x = (cosine * right)[None, :] + (sine * down)[:, None]
        y = (cosine * down)[:, None] - (sine * right)[None, :]
        return np.asarray(coefficient / np.maximum(light_factor(changes, x, y), 0.4), dtype=np.float32)


def light_factor(changes: Changes, x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
    """What the light is multiplied by at places in units of the body's radius."""
    along_x, along_y, _, xx, xy, yy, _, _ = changes
    return np.asarray(1.0 + x * (along_x + xx * x + xy * y) + y * (along_y + yy * y))


def without_light(changes: Changes) -> Changes:
    """The same scale and tilt under even light."""
    return tuple((np.array(changes) * SHAPE).tolist())


def added(one: Changes, other: Changes) -> Changes | None:
    """Both changes together; None where that is more than is followed."""
    both = np.add(one, other)
    return tuple(both.tolist()) if np.all(np.abs(both) <= MOST) else None


def _rows_in_use(changes: Changes) -> NDArray[np.intp]:
    """Places of the amplitudes of all groups that are not zero."""
    used = [np.arange(N_TERMS)[part] for part in GROUPS.values() if any(changes[part])]
    return np.concatenate(used) if used else np.zeros(0, dtype=np.intp)


def _placed(rows: NDArray[np.intp], amplitude: NDArray[np.float64]) -> Changes:
    whole = np.zeros(N_TERMS)
    whole[rows] = amplitude
    return tuple(whole.tolist())
