"""A measured press and release of felt: depth and force over time, and the noise of the force.

A CSV file with the columns ``time_s``, ``displacement_m`` and ``force_n``, evenly sampled; displacement is zero at
first touch and grows inwards. Laws need how fast the felt was pressed, so the time must be there. Where its noise asks
for it the depth is smoothed by local parabolas, and of a long press a few thousand samples are kept.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.arrays import ArrayRecord, as_numbers
from model.errors import InputError
from model.files.csv_columns import read_columns
from model.files.time_table import UNEVEN

FEWEST_SAMPLES = 40  # of a press
NOISE_OF_SPEED = 0.02  # share of the median speed that noise of the depth may make; smoothing rounds the turn off
WIDEST_SHARE = 0.05  # of the samples: widest window of the smoothing
MOST_SAMPLES = 3000  # kept of a press: what a law says between them is exact, and a fit's time grows with them

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Pressing(ArrayRecord):
    """A measured press and release.

    Attributes
    ----------
    name : of the file
    time_s, depth_m, force_n : (n,) evenly sampled; the depth smoothed
    noise_n : standard deviation of the force from sample to sample
    """

    name: str
    time_s: Array
    depth_m: Array
    force_n: Array
    noise_n: float

    @property
    def peak_n(self) -> float:
        """Largest force, N."""
        return float(self.force_n.max())

    @property
    def deepest_m(self) -> float:
        """Largest depth, m."""
        return float(self.depth_m.max())

    @property
    def speed_m_per_s(self) -> float:
        """Mean loading speed, m/s, from a tenth of the depth to the deepest point."""
        top = int(np.argmax(self.depth_m))
        # the first tenth may still be the tip finding the felt
        begin = int(np.argmax(self.depth_m[: top + 1] >= 0.1 * self.deepest_m))
        if top == begin:
            return float("nan")
        return float((self.depth_m[top] - self.depth_m[begin]) / (self.time_s[top] - self.time_s[begin]))


def _estimate_noise(values: Array) -> float:
    """Standard deviation of white noise on a smooth signal (n,): from third differences, which leave the signal out."""
    return 1.4826 * float(np.median(np.abs(np.diff(values, 3)))) / float(np.sqrt(1.0 + 9.0 + 9.0 + 1.0))


def _smooth_depth(depth_m: Array) -> Array:
    """Depth (n,) in local parabolas just wide enough for the speed; as it is where its noise does not matter."""
    # start-up: scipy.signal costs 0.4 s, and only measured presses need it
    from scipy.signal import savgol_filter

    step = float(np.median(np.abs(depth_m[8:] - depth_m[:-8]))) / 8.0
    if step <= 0.0:
        return depth_m
    # the slope of a parabola over w samples of noise s scatters by s sqrt(12 / w^3)
    width = (12.0 * (_estimate_noise(depth_m) / (NOISE_OF_SPEED * step)) ** 2) ** (1.0 / 3.0)
    if width < 3.0:
        return depth_m
    window = 2 * int(max(2.0, min(0.5 * width, 0.5 * WIDEST_SHARE * len(depth_m)))) + 1
    return np.asarray(savgol_filter(depth_m, window, 2), dtype=float)


def check_pressing(name: str, time_s: ArrayLike, displacement_m: ArrayLike, force_n: ArrayLike) -> Pressing:
    """Check one press and release, (n,) s, evenly spaced, m and N, depth and force positive where pressed; smooth its
    depths, thin it to at most `MOST_SAMPLES`. `InputError`, which begins with ``name``, else."""
    t, x, f = (as_numbers(v, name, 1) for v in (time_s, displacement_m, force_n))
    if not len(t) == len(x) == len(f) or len(t) < FEWEST_SAMPLES:
        raise InputError(f"{name}: found {len(t)} samples, allowed at least {FEWEST_SAMPLES}")
    bad = ~np.isfinite(np.column_stack([t, x, f])).all(axis=1)
    if bad.any():
        raise InputError(f"{name}: row {int(np.argmax(bad)) + 1}: found no number, allowed finite numbers")
    steps = np.diff(t)
    if (steps <= 0.0).any() or np.ptp(steps) > UNEVEN * float(np.median(steps)) * 2.0:
        raise InputError(f"{name}: time_s is not evenly spaced within {UNEVEN:.0%}; resample it, the laws need speeds")
    depth = _smooth_depth(x)
    top = int(np.argmax(depth))
    if not depth[top] > 0.0 or not f.max() > 0.0:
        raise InputError(f"{name}: never pressed: depth at most {depth[top]:g} m, force {f.max():g} N; check the signs")
    if top == 0 or depth[-1] > 0.5 * depth[top]:
        raise InputError(f"{name}: found one way only, allowed a press and its release down to half of its depth")
    kept = slice(None, None, -(-len(t) // MOST_SAMPLES))
    return Pressing(name, t[kept], depth[kept], f[kept], _estimate_noise(f))


def read_pressing(path: str | Path) -> Pressing:
    """Read one press and release from a CSV file with ``time_s,displacement_m,force_n`` (other columns are not read);
    depths are smoothed, long records thinned, one without a release is refused.

    Parameters
    ----------
    path : CSV file; other columns are not read

    Returns
    -------
    Pressing
        Times, s, smoothed depths, m, and forces, N.

    Raises
    ------
    InputError : the file cannot be read or used; the message names file and row

    Examples
    --------
    >>> import model
    >>> press = model.felt.read_pressing("presses/0.5mm_2mm_per_s.csv")
    >>> press.peak_n > 10.0
    True
    """
    table = read_columns(path, ("time_s", "displacement_m", "force_n"))
    return check_pressing(table.where, *(table.numbers(name) for name in ("time_s", "displacement_m", "force_n")))
