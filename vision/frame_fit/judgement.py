"""Accept or reject a fit: its flags. Compiled; Python calls the same functions."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from vision.fitting.kernels import F64
from vision.fitting.template import Template
from vision.kernel_cache import cached_njit, inner_njit
from vision.results.flags import FrameFlag

MIN_ZNCC = 0.6  # least correlation, as a share of what noise leaves of a perfect match: blur and light take a part too
CHANCE = 12.0
"""A correlation may be chance whose Fisher transform is below this over the root of the number of pixels: neighbouring
pixels are alike."""
LEAST_COMMON = 0.01  # where noise explains the reference altogether its contrast tells nothing of the gain
MIN_INLIER = 0.3  # least share of the pixels that agree, or that are left for a fit
MAX_JUMP_RAD = math.radians(8.0)  # from the expected pose: beyond the capture range of the fit
MAX_JUMP_PX = 12.0  # the same of a shift
USUAL_SHARE = 0.85  # least correlation as a share of the usual one; blur lowers it slowly, a wrong pose abruptly
NEW_SHARE = 0.1  # of a new fit in the usual correlation and gain: they follow within ten rows
NOISE_ONLY = 1.15  # residuals up to this many times the noise of the still frames are taken for noise
MIN_GAIN = 0.6
"""Flicker changes the light by some per cent; where the contrast changes more than by this factor, up or down, another
surface may hide the body."""
LEAST_LIGHT, SAME_LEVEL, SAME_INLIER = 0.25, 1.3, 0.9
"""Unless only the light has changed, by the first factor at most: then the mean grey value has changed with the
contrast (out of focus it does not), up to the second, and at least this share of the pixels agrees, as well as before.
"""
COVERED_SHARE = 0.1  # of the visible pixels that do not agree, or stop agreeing in a row; noise alone makes 0.003
LOW_CORRELATION, ODD_GAIN = int(FrameFlag.LOW_CORRELATION), int(FrameFlag.ODD_GAIN)
FEW_INLIERS, JUMP = int(FrameFlag.FEW_INLIERS), int(FrameFlag.JUMP)
NO_COVARIANCE, COVERED = int(FrameFlag.NO_COVARIANCE), int(FrameFlag.COVERED)


class Standards(NamedTuple):
    """What fits of m bodies are judged by: ``least_zncc``, and ``chance``, the correlation that may be one, (m,);
    ``contrast`` (m,), the share of the reference's contrast that is not its noise; ``noise_grey`` of the still frames
    (m,), and its variance over the texture's (m,); ``mean_grey`` (m,) of the reference; ``usual`` (m, 2) correlation, 0
    before the first fit, and gain: running means."""

    least_zncc: F64
    chance: F64
    contrast: F64
    noise_grey: F64
    noise_share: F64
    mean_grey: F64
    usual: F64

    @classmethod
    def from_templates(cls, templates: Sequence[Template]) -> Standards:
        """Standards of bodies before their first fit."""
        rows = []
        for template in templates:
            variance = float(np.var(template.columns[3]))
            texture = max(variance - template.noise_grey**2 / template.n_averaged, 0.0)
            expected = math.sqrt(texture / (texture + template.noise_grey**2)) if texture > 0.0 else 0.0
            # what noise left in the reference takes off the contrast in common with frames that are not part of it
            contrast = max(texture / max(variance, 1e-9), LEAST_COMMON)
            chance = math.tanh(CHANCE / math.sqrt(template.n_pixels))
            least = max(MIN_ZNCC * expected * math.sqrt(contrast), chance)
            share = template.noise_grey**2 / max(texture, 1e-9)
            rows.append((least, chance, contrast, template.noise_grey, share, template.mean_grey))
        columns = (np.array(column, dtype=float) for column in zip(*rows, strict=True))
        return cls._make([*columns, np.tile([0.0, 1.0], (len(templates), 1))])


class Figures(NamedTuple):
    """What a fit says of itself, as `fitting.base.Fit` has it."""

    zncc: float
    inlier: float
    noise_grey: float
    gain: float
    seen: float
    level: float


@inner_njit(_nrt=False)
def has_odd_gain(standards: Standards, body: int, gain: float) -> bool:
    """Whether the contrast has changed by more than lamps usually do."""
    least = MIN_GAIN * standards.contrast[body]
    return not least <= gain / standards.usual[body, 1] <= 1.0 / least


@inner_njit(_nrt=False)
def has_other_illumination(standards: Standards, body: int, figures: Figures) -> bool:
    """Whether one fit of ``body`` (index into ``standards``: usual correlation, gain, noise of all bodies), whose gain
    is odd, is as good as if only the light had changed; ``figures``: of this fit."""
    usual_zncc, usual_gain = standards.usual[body, 0], standards.usual[body, 1]
    changed = figures.gain / usual_gain
    if not (LEAST_LIGHT <= changed <= 1.0 / LEAST_LIGHT and figures.inlier >= SAME_INLIER):
        return False
    level = figures.level / (figures.gain * standards.mean_grey[body])
    if not 1.0 / SAME_LEVEL <= level <= SAME_LEVEL:
        return False
    noise = standards.noise_share[body] * max(1.0 / figures.gain**2 - 1.0 / usual_gain**2, 0.0)
    before = usual_zncc if usual_zncc != 0.0 else 1.0
    return figures.zncc >= USUAL_SHARE * (1.0 / math.sqrt(1.0 / before**2 + noise))


@cached_njit(nogil=True, _nrt=False)
def judge_fit(standards: Standards, body: int, figures: Figures, pose: F64, expected: F64, covariance: F64) -> int:
    """Flags (`FrameFlag`) of a body's (index) converged fit at ``pose``, by where it was ``expected``, its figures and
    ``covariance`` (3, 3); 0 for a good one."""
    flag, is_odd = 0, has_odd_gain(standards, body, figures.gain)
    is_lit = is_odd and has_other_illumination(standards, body, figures)
    # residuals that are the still frames' noise need no better correlation, however low that noise makes it
    is_noise = figures.noise_grey <= NOISE_ONLY * standards.noise_grey[body] * max(figures.gain, 1.0)
    is_usual = is_noise or is_lit or figures.zncc >= USUAL_SHARE * standards.usual[body, 0]
    least = standards.chance[body] if is_lit else standards.least_zncc[body]
    if not (figures.zncc >= least and is_usual):
        flag |= LOW_CORRELATION
    if is_odd and not is_lit:
        flag |= ODD_GAIN
    if not figures.inlier >= MIN_INLIER:
        flag |= FEW_INLIERS
    shift = math.hypot(pose[1] - expected[1], pose[2] - expected[2])
    if not (abs(pose[0] - expected[0]) <= MAX_JUMP_RAD and shift <= MAX_JUMP_PX):
        flag |= JUMP
    total = 0.0
    for j in range(3):
        for k in range(3):
            total += covariance[j, k]
    # one number that is not finite makes the sum so
    if not (math.isfinite(total) and covariance[0, 0] > 0.0):
        flag |= NO_COVARIANCE
    if flag == 0 and figures.seen - figures.inlier > COVERED_SHARE:
        flag = COVERED
    return flag


@cached_njit(nogil=True, _nrt=False)
def update_usual_quality(standards: Standards, body: int, figures: Figures) -> None:
    """Let a fit that is believed count for the usual correlation and gain; a lamp that was switched stays as it is."""
    usual, is_odd = standards.usual[body], has_odd_gain(standards, body, figures.gain)
    usual[0] = figures.zncc if usual[0] == 0.0 or is_odd else (1.0 - NEW_SHARE) * usual[0] + NEW_SHARE * figures.zncc
    usual[1] = figures.gain if is_odd else usual[1] + NEW_SHARE * (figures.gain - usual[1])
