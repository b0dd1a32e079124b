"""Friction of a joint from the free swings of its body, which is let go once and swings until it rests.

Between two turning points the joint takes its share of the energy: speed squared / 2 = w^2 cos(angle - hanging)
- s f angle + constant, s the sense of the swing, f friction over inertia. All of it is linear in the unknowns, so that
every sample counts and neither where the body hangs nor how far it was lifted need be known. f / w^2 is the friction as
a share of weight times arm.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rig.backend import Backend, Block
from rig.calibration.quiet_reading import read_quiet
from rig.configuration.rig_file import BODIES, RigConfig
from rig.errors import RigInputError

Array = NDArray[np.float64]
LONGEST_SWING_S = 60.0  # from the lift to rest; a swing that takes longer was not let go
STILL_S = 0.5  # within two counts: the swing has ended
SMOOTHED_S = 0.012  # length of the local parabola that gives the speed: what it flattens is in the uncertainty
LEAST_TURN_RAD = 0.1  # of a half swing that counts: 50 counts of a usual scale and more
MOVING_SHARE = 0.2  # of a half swing's largest speed, above which the sign of its friction is sure
FITTED_SAMPLES = 200  # of a half swing at most: more of them are not independent
FEWEST_SWINGS = 3  # half swings, so that their scatter is known


@dataclass(frozen=True)
class Swing:
    """What the swings of a body say."""

    # share, u_share: friction torque over weight times arm, and its standard uncertainty
    share: float
    u_share: float
    frequency_hz: float  # of small swings without friction
    half_swings: int  # how many counted
    top_rad_per_s: float = 0.0  # largest speed


def read_swing(backend: Backend, config: RigConfig, body: str) -> tuple[Array, float]:
    """Return the angle (n,), rad from any zero, of a body that is lifted and let go, until it has rested for 0.5 s, at
    most for 60 s, and the sample rate, Hz; refuse one that did not swing."""
    index = BODIES.index(body)
    encoder = config.encoders[index]
    counts: list[NDArray[np.int64]] = []
    swung, rate = False, 0.0

    def take(block: Block, rate_hz: float) -> bool:
        nonlocal swung, rate
        rate = rate_hz
        counts.append(block.encoder_count[:, index])
        size = counts[0].size
        recent = np.concatenate(counts[-int(STILL_S * rate_hz / size) - 1 :])
        swung = swung or float(np.ptp(recent)) * abs(encoder.rad_per_count) > LEAST_TURN_RAD
        return bool(swung and len(counts) * size > STILL_S * rate_hz and np.ptp(recent) <= 2)

    read_quiet(backend, config, config.recording.block_s, LONGEST_SWING_S, take)
    angle: Array = np.concatenate(counts).astype(np.float64) * encoder.rad_per_count
    if not swung:
        raise RigInputError(
            f"{encoder.counter}: the {body} did not swing within {LONGEST_SWING_S:g} s; lift it and let it go"
        )
    return angle, rate


def fit_joint_friction(angle_rad: Array, rate_hz: float, body: str) -> Swing:
    """Fit to the angle (n,), rad, of a freely swinging body the joint's friction torque as a share of weight times arm,
    with standard uncertainty and frequency, Hz; refuse fewer than three half swings, and one that gains energy."""
    half = max(int(SMOOTHED_S * rate_hz / 2), 2)
    k = np.arange(-half, half + 1)
    speed = np.convolve(angle_rad, -k / (k @ k) * rate_hz, mode="valid")
    smooth = np.convolve(angle_rad, np.full(k.size, 1.0 / k.size), mode="valid")
    spans = _half_swings(smooth, speed)
    if len(spans) < FEWEST_SWINGS:
        raise RigInputError(
            f"{body}: {len(spans)} half swings of {LEAST_TURN_RAD:g} rad or more, allowed from {FEWEST_SWINGS}; let it "
            "go from higher up, or hang a weight of known moment on it"
        )
    share, omega2 = _fit_energy(smooth, speed, spans)
    each = np.array([_fit_energy(smooth, speed, spans[:i] + spans[i + 1 :])[0] for i in range(len(spans))])
    n = len(spans)
    jackknife = float(np.sqrt((n - 1) / n * np.sum((each - each.mean()) ** 2)))
    if share <= 0 or omega2 <= 0:
        raise RigInputError(f"{body}: gains energy as it swings ({share:.3g}); look for a push, or the encoder's sign")
    frequency = float(np.sqrt(omega2) / (2 * np.pi))
    # the parabola takes this share off a speed that changes within it
    flattened = share * (2 * np.pi * frequency * half / rate_hz) ** 2 / 10  # slope of a line through a sine
    return Swing(share, float(np.hypot(jackknife, flattened)), frequency, n, float(np.abs(speed).max()))


def _half_swings(angle: Array, speed: Array) -> list[tuple[int, int]]:
    """Spans (first, last sample) of half swings by more than 0.1 rad in ``angle`` (n,), rad, between sign changes of
    ``speed`` (n,), rad/s, each cut to where it is faster than a fifth of its largest speed; the first may begin at the
    release."""
    turns = np.flatnonzero(np.diff(np.signbit(speed).astype(int)) != 0) + 1
    edges = np.concatenate(([0], turns, [speed.size]))
    spans = []
    for first, end in zip(edges[:-1], edges[1:], strict=True):
        moving = np.flatnonzero(np.abs(speed[first:end]) > MOVING_SHARE * np.abs(speed[first:end]).max(initial=0.0))
        if moving.size and abs(angle[end - 1] - angle[first]) > LEAST_TURN_RAD:
            spans.append((int(first + moving[0]), int(first + moving[-1])))
    return spans


def _fit_energy(angle: Array, speed: Array, spans: list[tuple[int, int]]) -> tuple[float, float]:
    """Return friction torque over weight times arm, and the squared angular frequency of small swings, (rad/s)², from
    the energy along ``spans`` (first sample, end) of ``angle`` (n,), rad, and ``speed`` (n,), rad/s."""
    rows, energy = [], []
    for number, (first, end) in enumerate(spans):
        step = max((end - first) // FITTED_SAMPLES, 1)
        a, v = angle[first:end:step], speed[first:end:step]
        offsets = np.zeros((a.size, len(spans)))
        offsets[:, number] = 1.0
        rows.append(np.column_stack([np.cos(a), np.sin(a), -np.sign(v) * a, offsets]))
        energy.append(0.5 * v * v)
    found, *_ = np.linalg.lstsq(np.concatenate(rows), np.concatenate(energy), rcond=None)
    omega2 = float(np.hypot(found[0], found[1]))
    return float(found[2]) / omega2, omega2
