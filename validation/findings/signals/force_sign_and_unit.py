"""Force of the wrong sign or in the wrong unit: the trial moves as the model does when the force is taken otherwise.

Conventions: errors are root mean squares of model − trial over the trial's own motion, of key, whippen and hammer
each, until the release. A trial is looked at only when the model misses at least 30 % of the motion of a body; a
factor is named when it leaves at most 40 % of each body's error. Soft strokes are not predicted that well: where the
key goes its way and the model's hardly moves, or lifts, under the force as recorded, a reversed sign or a factor of
four and more is also named when key and whippen then travel as far as in the trial. A force too large shows only as
far as stops allow, and a smaller error of the gain looks like friction: both may stay silent.
"""

from __future__ import annotations

from dataclasses import asdict

import numpy as np
from numpy.typing import NDArray

from model.errors import ModelError
from validation.conventions import ENCODER_BODIES, ENCODER_CHANNELS, Array
from validation.findings.finding import SessionFinding
from validation.measurement.trial import MeasuredTrial
from validation.prediction.model_under_test import ModelUnderTest
from validation.prediction.trial_prediction import PredictedAngles

MISSED = 0.3  # of the motion
LEAVES = 0.4  # of the error
STILL_MISSES = 0.7  # of the motion: more is no explanation
LARGEST_N = 500.0  # beyond any stroke
HARDLY = 0.25  # of the trial's turn of the key, the way the trial goes
GROSS = 4.0  # smallest factor that a key which hardly moves is told by: friction cannot do that
TRAVEL = 0.2  # largest difference of travels that are alike
# what the recorded force would have to be multiplied by, and the mistake that makes it so
FACTORS = {
    -1.0: "its sign is reversed",
    4.448222: "as if pounds-force were taken for newtons",
    1 / 4.448222: "as if newtons were taken for pounds-force",
    9.80665: "as if kilograms-force were taken for newtons",
    1 / 9.80665: "as if newtons were taken for kilograms-force",
    1e3: "as if kilonewtons were taken for newtons",
    1e-3: "as if millinewtons were taken for newtons",
    2.0: "as after a gain or excitation of half the declared one",
    0.5: "as after a gain or excitation of twice the declared one",
}


def force_sign_and_unit(
    tested: ModelUnderTest, m: MeasuredTrial, p: PredictedAngles, until_s: float
) -> list[SessionFinding]:
    """The factor on the force that explains why the model does not move as the trial does; known results are reused."""
    expected = np.column_stack([p.change_rad(name) for name in ENCODER_CHANNELS])
    known = np.isfinite(expected).all(axis=1) & (m.time_s <= until_s)
    if not known.any():
        return []
    size = np.sqrt(np.mean(m.change_rad[known] ** 2, axis=0))
    if not np.all(size > 0):
        return []
    errors = _errors(expected[known], m.change_rad[known], size)
    if errors.max() < MISSED:
        return []
    force = m.force
    found = tested.store.value(
        "force sign and unit",
        (tested.identity, m.number, force.time_s, force.force_n, force.preload_n, m.time_s, m.change_rad, until_s),
        lambda: [asdict(f) for f in _search(tested, m, expected[known], known)],
    )
    return [SessionFinding(**f) for f in found]


def _errors(expected: Array, trial: Array, size: Array) -> Array:
    return np.asarray(np.sqrt(np.mean((expected - trial) ** 2, axis=0)) / size)


def _furthest(change: Array) -> Array:
    """Change of each body where it is furthest from rest, with its sign."""
    return np.asarray(np.take_along_axis(change, np.abs(change).argmax(axis=0)[None], axis=0)[0])


def _search(
    tested: ModelUnderTest, m: MeasuredTrial, expected: Array, inside: NDArray[np.bool_]
) -> list[SessionFinding]:
    force, trial = m.force, m.change_rad[inside]
    size = np.sqrt(np.mean(trial**2, axis=0))
    errors = _errors(expected, trial, size)
    far = _furthest(trial)
    still = bool((expected[:, 0] * np.sign(far[0])).max() < HARDLY * abs(far[0]))
    rest = tested.load(force.preload_n).rest
    left: dict[float, float] = {}
    for factor in FACTORS:
        # the declared preload stays: it is what the arm rests with, whatever the channel reads
        taken = force.preload_n + factor * (force.force_n - force.preload_n)
        if float(np.abs(taken).max()) > LARGEST_N:
            continue
        try:
            run = tested.simulate(
                tested.action,
                force.time_s,
                taken,
                tolerance=tested.tolerance,
                output_time_s=m.time_s[inside],
                initial=rest,
            )
        except ModelError:
            continue
        change = np.asarray(run.angle_rad, dtype=float) - np.asarray(rest.angle_rad, dtype=float)
        change = change[:, ENCODER_BODIES]
        by_body = _errors(change, trial, size)
        explains = bool(np.all(by_body < np.minimum(LEAVES * errors, STILL_MISSES)))
        if still and (factor < 0 or factor >= GROSS):
            explains |= bool(np.all(np.abs(_furthest(change) / far - 1)[:2] < TRAVEL) and np.all(by_body < errors))
        if explains:
            left[factor] = float(np.sqrt(np.mean(by_body**2)))
    order = sorted(left, key=lambda factor: left[factor])
    if not order:
        return []
    error = float(np.sqrt(np.mean(errors**2)))
    best = order[0]
    alike = [factor for factor in order if left[factor] < 1.5 * left[best]]
    kind = "force sign" if best < 0 else "force unit"
    words = " or ".join(f"× {factor:.4g} ({FACTORS[factor]})" for factor in alike)
    text = (
        f"trial {m.number}: force: the model misses {100 * error:.0f} % of the motion under the force as recorded and "
        f"{100 * left[best]:.0f} % when it is taken {words}; check sign, unit and calibration of the load cell"
    )
    return [SessionFinding(kind, m.number, "force", best, MISSED, text)]
