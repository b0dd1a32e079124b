"""Mean normal speed of every contact during a blow, the x-dot-ave of eq. 2.7.

A motion of all five bodies goes in: simulated, or measured (encoders for key, whippen and hammer, film for jack and
repetition lever). The averaging rule, which the thesis does not print: an instant counts for a contact while its felt
is pressed and its normal speed is at least 2 % of the largest while pressed in this motion; the mean is over the
magnitudes at these instants, weighted by time. A contact that is never pressed has no mean (NaN).
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.arrays import ArrayRecord, as_numbers
from model.codegen.evaluate_observables import contacts_at
from model.codegen.observable_columns import DEPTH
from model.errors import InputError
from model.files.csv_columns import read_columns
from model.files.time_table import UNEVEN
from model.parameters.action import BODIES, ActionLike, as_action
from model.scene.build import build_scene

REST_SHARE = 0.02  # of the largest speed of its sign: choice; slower touches hardly rub or damp
FEWEST_ROWS = 8  # a derivative and its ends
SMOOTHING_S = 2e-3  # window of the derivative of measured angles
_NUDGE_S = 1e-7  # step along the motion: gaps are smooth in the angles, so the error is far below a micrometre a second

Array = NDArray[np.float64]


@dataclass(frozen=True)
class MeanSpeeds(ArrayRecord):
    """Mean normal speeds.

    Attributes
    ----------
    contacts : (c,) names
    speed_m_per_s : (c,) mean; NaN where the contact was never pressed
    pressed_s, counted_s : (c,) time pressed, and time that counted (pressed and not at rest)
    """

    contacts: tuple[str, ...]
    speed_m_per_s: Array
    pressed_s: Array
    counted_s: Array

    def mean_speed(self, contact: str) -> float:
        """Mean normal speed, m/s, of one contact; ``InputError`` where it was never pressed or does not exist."""
        if contact not in self.contacts:
            raise InputError(f"contact {contact}: not found; allowed {', '.join(self.contacts)}")
        speed = float(self.speed_m_per_s[self.contacts.index(contact)])
        if not speed > 0.0:
            raise InputError(f"contact {contact}: never pressed in this motion, so it has no mean speed; take another")
        return speed

    of = mean_speed  # former names, for one release


def mean_normal_speeds(
    action: ActionLike,
    time_s: ArrayLike,
    angle_rad: ArrayLike,
    speed_rad_per_s: ArrayLike | None = None,
    rest_share: float = REST_SHARE,
) -> MeanSpeeds:
    """Mean absolute normal speed, m/s, of each contact along a motion, angles and speeds (m, 5) of the bodies (speeds
    None: differentiated), over the time when it is pressed and faster than ``rest_share`` of its largest.

    Parameters
    ----------
    action : geometry of the contacts
    time_s : (m,) increasing
    angle_rad : (m, 5) as in `Solution.angle_rad`
    speed_rad_per_s : (m, 5); by default the derivative of the angles (local parabolas over ``SMOOTHING_S``)
    rest_share : share of a contact's largest speed below which it is at rest

    Returns
    -------
    MeanSpeeds
        Mean speed of each contact, m/s, NaN where it was never pressed.

    Raises
    ------
    InputError : shapes that do not belong together, or times that do not increase

    Examples
    --------
    >>> import model
    >>> blow = model.simulate(model.load_action(), *model.force_table("forte"))
    >>> speeds = model.calibration.mean_normal_speeds(model.load_action(), blow.time_s, blow.angle_rad)
    >>> speeds.mean_speed("contact12") > speeds.mean_speed("contact02")  # the string is met faster than the key's felt
    True
    """
    action = as_action(action)
    t, q = as_numbers(time_s, "motion: times", 1), as_numbers(angle_rad, "motion: angles")
    if q.shape != (len(t), len(BODIES)):
        raise InputError(f"motion: angles found of shape {q.shape}, allowed ({len(t)}, {len(BODIES)})")
    bad = ~np.isfinite(np.column_stack([t, q])).all(axis=1)
    if bad.any():
        raise InputError(
            f"motion: row {int(np.argmax(bad)) + 1}: found lost data, allowed finite numbers; cut these rows out"
        )
    if len(t) < FEWEST_ROWS or (np.diff(t) <= 0.0).any():
        raise InputError(f"motion: times must increase, over at least {FEWEST_ROWS} rows")
    v = _differentiate(t, q) if speed_rad_per_s is None else as_numbers(speed_rad_per_s, "motion: speeds")
    if v.shape != q.shape:
        raise InputError(f"motion: speeds found of shape {v.shape}, allowed that of the angles, {q.shape}")
    scene = build_scene(action)

    def depth(at: Array) -> Array:
        return contacts_at(scene.static_tables, scene.vector, at, v)[:, :, DEPTH]

    pressed = depth(q) > 0.0
    rate = np.abs(depth(q + _NUDGE_S * v) - depth(q - _NUDGE_S * v)) / (2.0 * _NUDGE_S)
    peak = np.where(pressed, rate, 0.0).max(axis=0)
    counts = pressed & (rate >= rest_share * peak) & (peak > 0.0)
    share = np.gradient(t)[:, None]
    counted = np.where(counts, share, 0.0).sum(axis=0)
    total = np.where(counts, share * rate, 0.0).sum(axis=0)
    mean = np.divide(total, counted, out=np.full(len(peak), np.nan), where=counted > 0.0)
    return MeanSpeeds(tuple(scene.contacts), mean, np.where(pressed, share, 0.0).sum(axis=0), counted)


def _differentiate(t: Array, q: Array) -> Array:
    """Rates (n, k), per s, of columns q (n, k) at evenly spaced times t (n,), s, by a Savitzky–Golay filter."""
    # start-up: scipy.signal costs 0.4 s, and only measured angles without speeds need it
    from scipy.signal import savgol_filter

    step = float(np.median(np.diff(t)))
    if np.ptp(np.diff(t)) > UNEVEN * step:
        raise InputError("motion: times are not evenly spaced; give the speeds (columns …_rad_per_s) too")
    window = max(FEWEST_ROWS // 2 + 1, 2 * round(0.5 * SMOOTHING_S / step) + 1)
    if window > len(t):
        raise InputError(f"motion: {len(t)} rows found, allowed at least {window} at this rate")
    return np.asarray(savgol_filter(q, window, 2, deriv=1, delta=step, axis=0), dtype=float)


def read_motion(path: str | Path) -> tuple[Array, Array, Array | None]:
    """Read times (n,), angles and, if there, speeds (n, 5) from a CSV file with the columns that ``pianorig simulate
    --out`` writes.

    Parameters
    ----------
    path : CSV file with ``time_s``, ``<body>_rad`` and, if all five are there, ``<body>_rad_per_s``

    Returns
    -------
    tuple
        Times (m,), s, angles (m, 5), rad, and speeds (m, 5), rad/s, or None.

    Raises
    ------
    InputError : the file cannot be read, or a body is missing

    Examples
    --------
    >>> import model
    >>> blow = model.simulate(model.load_action(), *model.force_table("forte"))
    >>> path = blow.save("motion.csv")
    >>> time_s, angle_rad, speed_rad_per_s = model.calibration.read_motion("motion.csv")
    >>> angle_rad.shape
    (3501, 5)
    """
    table = read_columns(path, ["time_s", *(f"{body}_rad" for body in BODIES)])
    angles = np.column_stack([table.numbers(f"{body}_rad") for body in BODIES])
    names = [f"{body}_rad_per_s" for body in BODIES]
    speeds = np.column_stack([table.numbers(n) for n in names]) if set(names) <= set(table.names) else None
    return table.numbers("time_s"), angles, speeds
