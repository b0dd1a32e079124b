"""The decisions of tracking, written to be read: what the compiled ones are compared with."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from vision import FrameFlag

F64 = NDArray[np.float64]


def turn_by(angle: float) -> F64:
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


@dataclass
class Trace:
    """Placements (turn, x, y) by step."""

    places: dict[int, F64] = field(default_factory=dict)

    def predict(self, step: int) -> F64:
        """The parabola, the line or the place of the newest neighbours, if they end just before the step."""
        newest = max(self.places)
        if newest != step - 1:
            return self.places[newest]
        run = [newest]
        while run[0] - 1 in self.places and len(run) < 3:
            run.insert(0, run[0] - 1)
        past = np.array([self.places[k] for k in run])
        return np.array([np.polyval(np.polyfit(run, one, len(run) - 1), step) for one in past.T])


@dataclass
class PlainBody:
    """A body that is predicted in the axes of its parent where that is placed at the same step."""

    centre: F64
    parent: PlainBody | None = None
    absolute: Trace = field(default_factory=Trace)
    relative: Trace = field(default_factory=Trace)

    def parent_at(self, step: int) -> F64 | None:
        return None if self.parent is None else self.parent.absolute.places.get(step)

    def place(self, step: int, pose: F64) -> None:
        place = pose + np.array([0.0, *self.centre])
        self.absolute.places[step] = place
        parent = self.parent_at(step)
        if parent is not None:
            shift = turn_by(-parent[0]) @ (place[1:] - parent[1:])
            self.relative.places[step] = np.array([place[0] - parent[0], *shift])

    def expect(self, step: int) -> F64:
        parent = self.parent_at(step)
        if parent is not None and self.relative.places:
            own = self.relative.predict(step)
            place = np.array([own[0] + parent[0], *(parent[1:] + turn_by(parent[0]) @ own[1:])])
        else:
            place = self.absolute.predict(step)
        return place - np.array([0.0, *self.centre])


@dataclass(frozen=True)
class PlainStandards:
    """What a fit of one body is judged by."""

    least_zncc: float
    chance: float
    contrast: float
    noise_grey: float
    noise_share: float
    mean_grey: float
    usual_zncc: float
    usual_gain: float


def plain_flags(s: PlainStandards, fit: dict[str, float], step: F64, covariance: F64) -> FrameFlag:
    """Flags of a fit that has moved by ``step`` (turn, x, y) from where it was expected."""
    changed = fit["gain"] / s.usual_gain
    is_odd = not 0.6 * s.contrast <= changed <= 1.0 / (0.6 * s.contrast)
    noise = s.noise_share * max(fit["gain"] ** -2 - s.usual_gain**-2, 0.0)
    is_lit = (
        is_odd
        and 0.25 <= changed <= 4.0
        and fit["inlier"] >= 0.9
        and 1.0 / 1.3 <= fit["level"] / (fit["gain"] * s.mean_grey) <= 1.3
        and fit["zncc"] >= 0.85 * ((s.usual_zncc or 1.0) ** -2 + noise) ** -0.5
    )
    is_noise = fit["noise_grey"] <= 1.15 * s.noise_grey * max(fit["gain"], 1.0)
    failures = {
        FrameFlag.LOW_CORRELATION: fit["zncc"] < (s.chance if is_lit else s.least_zncc)
        or not (is_noise or is_lit or fit["zncc"] >= 0.85 * s.usual_zncc),
        FrameFlag.ODD_GAIN: is_odd and not is_lit,
        FrameFlag.FEW_INLIERS: fit["inlier"] < 0.3,
        FrameFlag.JUMP: abs(step[0]) > np.radians(8.0) or np.hypot(*step[1:]) > 12.0,
        FrameFlag.NO_COVARIANCE: not np.isfinite(covariance).all() or covariance[0, 0] <= 0.0,
    }
    found = FrameFlag(sum(int(flag) for flag, holds in failures.items() if holds))
    return found or (FrameFlag.COVERED if fit["seen"] - fit["inlier"] > 0.1 else FrameFlag.GOOD)
