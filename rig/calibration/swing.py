"""Friction of a joint from the free swings of its body: let go once, until it rests.

Between two turning points the joint takes its share of the energy: speed squared / 2 = w^2 cos(angle - hanging) - s f
angle + constant, s the sense of the swing, f friction over inertia. All of it is linear in the unknowns, so that every
sample counts and neither where the body hangs nor how far it was lifted need be known. f / w^2 is the friction as a
share of weight times arm.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rig.backend import Backend
from rig.configuration.channels import BODIES
from rig.configuration.rig_file import RigConfig
from rig.errors import RigInputError

LONGEST_S = 60.0
STILL_S = 0.5
READ_TIMEOUT_S = 5.0
SMOOTHED_S = 0.012
"""Length of the local parabola that gives the speed."""
LEAST_TURN_RAD = 0.1
"""Way of a half swing that counts."""
FEWEST_SWINGS = 3
Array = NDArray[np.float64]


@dataclass(frozen=True)
class Swing:
    """What the swings of a body say.

    Attributes
    ----------
    share, u_share : friction torque over weight times arm, and its standard uncertainty
    frequency_hz : of small swings without friction
    half_swings : how many counted
    top_rad_per_s : largest speed
    """

    share: float
    u_share: float
    frequency_hz: float
    half_swings: int
    top_rad_per_s: float = 0.0


def read_swing(backend: Backend, config: RigConfig, body: str) -> tuple[Array, float]:
    """Return the angle of a body, rad, from before it is let go until it has rested, and the sample rate, Hz.

    Raises
    ------
    RigInputError
        Nothing swung within a minute.
    HardwareFault
        As when recording.
    """
    index = BODIES.index(body)
    encoder = config.encoders[index]
    timing = backend.configure(config.model_copy(update={"camera": None, "watchdog": None}), None)
    rate = timing.sample_rate_hz
    size = max(int(config.recording.block_s * rate), 1)
    counts: list[NDArray[np.int64]] = []
    swung = False
    try:
        backend.arm(enable_drive=False)
        backend.start()
        for _ in range(int(LONGEST_S * rate) // size):
            counts.append(backend.read_block(size, READ_TIMEOUT_S).encoder_count[:, index])
            recent = np.concatenate(counts[-int(STILL_S * rate / size) - 1 :])
            swung = swung or float(np.ptp(recent)) * 2 * np.pi / encoder.counts_per_revolution > LEAST_TURN_RAD
            if swung and len(counts) * size > STILL_S * rate and np.ptp(recent) <= 2:
                break
    finally:
        backend.safe_stop()
    per_count = encoder.sign * 2 * np.pi / encoder.counts_per_revolution
    angle: Array = np.concatenate(counts).astype(np.float64) * per_count
    if not swung:
        raise RigInputError(
            f"{encoder.counter}: the {body} did not swing within {LONGEST_S:g} s; lift it and let it go"
        )
    return angle, rate


def friction_of_swing(angle_rad: Array, rate_hz: float, body: str) -> Swing:
    """Find the friction of a joint from the angle of its freely swinging body, (n,).

    Raises
    ------
    RigInputError
        Fewer than three half swings: more friction than can be seen so, or let go too low.
    """
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
    share, omega2 = _fit(smooth, speed, spans)
    each = np.array([_fit(smooth, speed, spans[:i] + spans[i + 1 :])[0] for i in range(len(spans))])
    n = len(spans)
    jackknife = float(np.sqrt((n - 1) / n * np.sum((each - each.mean()) ** 2)))
    if share <= 0 or omega2 <= 0:
        raise RigInputError(f"{body}: gains energy as it swings ({share:.3g}); look for a push, or the encoder's sign")
    frequency = float(np.sqrt(omega2) / (2 * np.pi))
    # the parabola takes this share off a speed that changes within it
    flattened = share * (2 * np.pi * frequency * half / rate_hz) ** 2 / 10
    return Swing(share, float(np.hypot(jackknife, flattened)), frequency, n, float(np.abs(speed).max()))


def _half_swings(angle: Array, speed: Array) -> list[tuple[int, int]]:
    """Spans between turning points in which the body goes far enough; the first begins where it was let go."""
    turns = np.flatnonzero(np.diff(np.signbit(speed).astype(int)) != 0) + 1
    edges = np.concatenate(([0], turns, [speed.size]))
    spans = []
    for first, end in zip(edges[:-1], edges[1:], strict=True):
        moving = np.flatnonzero(np.abs(speed[first:end]) > 0.2 * np.abs(speed[first:end]).max(initial=0.0))
        if moving.size and abs(angle[end - 1] - angle[first]) > LEAST_TURN_RAD:
            spans.append((int(first + moving[0]), int(first + moving[-1])))
    return spans


def _fit(angle: Array, speed: Array, spans: list[tuple[int, int]]) -> tuple[float, float]:
    """Friction over weight times arm, and the square of the small swings' angular frequency."""
    rows, energy = [], []
    for number, (first, end) in enumerate(spans):
        step = max((end - first) // 200, 1)
        a, v = angle[first:end:step], speed[first:end:step]
        own = np.zeros((a.size, len(spans)))
        own[:, number] = 1.0
        rows.append(np.column_stack([np.cos(a), np.sin(a), -np.sign(v) * a, own]))
        energy.append(0.5 * v * v)
    found, *_ = np.linalg.lstsq(np.concatenate(rows), np.concatenate(energy), rcond=None)
    omega2 = float(np.hypot(found[0], found[1]))
    return float(found[2]) / omega2, omega2
