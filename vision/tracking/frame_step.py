"""All bodies of one film on their way through it, parents first.

Place in the data flow: `preparation` steps it through the still frames, `track` through the film. Holds one
`Follower` per body and decides in which order they are fitted and which pixels are left out because another
body is in front.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vision.bodies.outlines import Body, parents_first
from vision.film.source import FrameSource
from vision.fitting.base import Fitter
from vision.fitting.template import Template
from vision.tracking.body_tracker import Follower
from vision.tracking.flags import FAILURE
from vision.tracking.still_average import Reference


class Run:
    """The bodies of one film on their way through it.

    Parameters
    ----------
    film : FrameSource
    bodies : sequence of Body
    templates : list of Template
        In the order of the bodies.
    method : {"icgn", "ecc"}
    """

    def __init__(self, film: FrameSource, bodies: Sequence[Body], templates: list[Template], method: str) -> None:
        self.film, self.bodies, self.templates, self.method = film, bodies, templates, method
        self.order = parents_first(bodies)
        # compiled: loaded only when a film is really tracked
        from vision.bodies.occlusion import Covering

        self._covering = Covering(bodies, templates, film.height, film.width)
        self.searches = 0
        self.followers: list[Follower] = []
        self.restart()

    def restart(self) -> None:
        """Put every body back to its place in the reference."""
        self.searches += sum(follower.searches for follower in self.followers)
        fitters = [_fitter(template, self.method) for template in self.templates]
        self.followers = [Follower(fitter) for fitter in fitters]
        names = [body.name for body in self.bodies]
        for i in self.order:
            parent = self.bodies[i].parent
            self.followers[i].parent = None if parent is None else self.followers[names.index(parent)]
            self.followers[i].start()

    def step(self, index: int, step: int, search: bool = True) -> None:
        """Fit all bodies in one frame, parents first."""
        for i in self.order:
            self.followers[i].step(self.film, index, step, self._covered(i, step), search)

    def _covered(self, i: int, step: int) -> NDArray[np.uint8] | None:
        """Template pixels of a body that the bodies in front hide, by their poses where known, else as
        predicted."""
        in_front = self._covering.in_front[i]
        if not in_front:
            return None
        poses = {}
        for j in in_front:
            other = self.followers[j]
            known = other.absolute.newest_step() == step
            poses[j] = other.fit.pose if known else other.predict(step)
        return self._covering.covered(i, self.followers[i].predict(step), poses)

    def info(self, reference: Reference) -> dict[str, Any]:
        """Counts and settings worth keeping with the result."""
        return {
            "pixels": {template.name: template.n_pixels for template in self.templates},
            "noise_grey": reference.noise_grey,
            "wide_searches": self.searches + sum(follower.searches for follower in self.followers),
        }


def _fitter(template: Template, method: str) -> Fitter:
    if method == "ecc":
        from vision.fitting.ecc import EccFitter

        return EccFitter(template)
    from vision.fitting.icgn import IcgnFitter

    return IcgnFitter(template)


def first_poses(run: Run, n: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Poses and their standard uncertainties in the first n frames, each (n, n_bodies, 3), NaN where lost."""
    pose, u = np.full((n, len(run.bodies), 3), np.nan), np.full((n, len(run.bodies), 3), np.nan)
    for step in range(n):
        run.step(step, step, search=False)
        for i, follower in enumerate(run.followers):
            if not follower.flag & FAILURE:
                pose[step, i], u[step, i] = follower.fit.pose, np.sqrt(np.diag(follower.fit.covariance))
    return pose, u
