"""Frame times from stamps: spacing, missing frames, time scale.

A video's stamps may be those of play-back: a camera writes 2,000 frames/s as 25. A rate that the user states then gives
the scale. Where the stamps are even, frames follow at that rate. Where they are not, their pattern tells what happened,
and only their scale is changed:

- intervals that are whole multiples of one another: frames were left out (*gap*);
- other intervals in no order: the camera itself was uneven (*variable rate*);
- intervals that stay longer for a while, then shorter: a slow-motion ramp of play-back. Such stamps cannot be a
  constant multiple of the times at which frames were taken, so they are refused. Whether neighbouring intervals are
  alike is asked by Bartels' rank version of von Neumann's ratio (Bartels 1982, J. Am. Stat. Assoc. 77, 40), at a
  false alarm in 10,000 uneven films.

Times that a camera wrote are not scaled: a stated rate is only compared with them.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from vision.errors import FilmError, VisionInputError, VisionWarning
from vision.film.source import FrameSource

F64 = NDArray[np.float64]

RAMP_SCORE = -3.72  # standard normal quantile of 1e-4
TICKS = 1.001  # that a stamp rounded to a tick may be off, with a thousandth for the rounding of numbers
COARSEST = 0.3  # tick over the interval, up to which rounding is allowed for: below a half, multiples stay apart
WHOLE = 0.1  # intervals may be off a whole multiple by this share of the interval: the jitter of a computer's clock
MOSTLY = 0.8  # of coarse intervals, that are single: of one that is no whole number of ticks fewer would be
FINE_TICKS = 8.0  # from this many ticks an interval on, rounding to ticks (a sixteenth) is no whole multiple of it
LEAST_RAMP, SURE_RAMP = 1.02, 3.0
"""Smallest change of pace that counts (2 % are 20 us at 1,000/s), and that of a ramp although its intervals are whole
multiples: phones halve their rate in the dark, slow motion is played 4 or 8 times slower."""
RUN = 5  # intervals whose median is the pace at a place: two of them may be gaps
LONG = 2.0
"""An interval of so many medians is said, though intervals are no whole multiples: frames may be missing there."""
CLOCKS_AGREE = 1e-4
"""Quartz clocks of cameras and computers agree within 100 ppm, and rates are written with four digits at least."""

Kind = Literal["even", "gaps", "variable", "ramp"]


@dataclass(frozen=True)
class Spacing:
    """How stamps follow one another."""

    kind: Kind
    # from a frame to the next where none is missing: the mean of evenly spaced stamps, else the median
    interval_s: float
    # (n - 1,), frames left out after each frame; zero where the intervals are not whole multiples
    missing: NDArray[np.int64]


def classify_spacing(stamp_s: F64, tick_s: float, nominal_s: float | None = None) -> Spacing:
    """How stamps (n,), s, rounded to ``tick_s``, follow one another: evenly, with gaps, at a variable rate or as a ramp
    of play-back, their interval, s, and the frames missing after each; `FilmError` for stamps that go back, or too
    coarse to tell.

    Parameters
    ----------
    stamp_s : ndarray, shape (n,), n > 1
    tick_s : what stamps are rounded to, s; 0 when they are not
    nominal_s : interval that the file states beside its stamps
    """
    intervals = np.diff(stamp_s)
    none = np.zeros(intervals.size, dtype=np.int64)
    median = float(np.median(intervals))
    rounding = 1e-9 * float(np.abs(stamp_s).max(initial=0.0)) + 1e-12
    # rounded to a tick they lie within one about their line, and a fit is off it by less than one
    for interval, width in ((nominal_s, TICKS), (_even_interval(stamp_s, intervals, tick_s, median), 2.0)):
        if interval and np.ptp(stamp_s - interval * np.arange(stamp_s.size)) <= width * tick_s + rounding:
            return Spacing("even", interval, none)
    if intervals.min() <= 0.0:
        at = int(np.argmin(intervals > 0.0))
        if intervals.min() >= 0.0 and np.ptp(stamp_s) < 2.0 * tick_s * intervals.size:
            raise FilmError(
                f"its time stamps are uneven, and at {1e3 * tick_s:g} ms too coarse to tell which frames are missing; "
                "an AVI, MOV or MP4 film keeps them"
            )
        raise FilmError(f"frames {at} and {at + 1} have the same time stamp, or stamps that go back")
    multiple = _multiples(intervals, tick_s, median)
    if multiple is None:
        # where most frames were left out, the shortest interval is that of the camera
        multiple = _multiples(intervals, tick_s, float(intervals.min()))
    if _is_serial(intervals) and _pace_ratio(intervals) > (LEAST_RAMP if multiple is None else SURE_RAMP):
        return Spacing("ramp", median, none)
    if multiple is not None and multiple.max() > 1:
        return Spacing("gaps", float(intervals.sum() / multiple.sum()), multiple - 1)
    return Spacing("variable", median, none)


def _multiples(intervals: F64, tick_s: float, base_s: float) -> NDArray[np.int64] | None:
    """Intervals (n - 1,) as whole multiples of one that is near ``base_s``, which the file may round to ``tick_s``;
    None where they are none."""
    single = intervals[np.rint(intervals / base_s) == 1.0]
    if not single.size:
        return None
    # rounded to ticks, one alone is too coarse to count what a long gap lacks
    base_s = float(single.mean())
    multiple = np.rint(intervals / base_s)
    if multiple.min() >= 1.0:
        base_s = float(intervals.sum() / multiple.sum())
        multiple = np.rint(intervals / base_s)
    slack = max(WHOLE, min(TICKS * tick_s / base_s, COARSEST))
    if multiple.min() < 1.0 or np.any(np.abs(intervals / base_s - multiple) > slack):
        return None
    return multiple.astype(np.int64)


def _even_interval(stamp_s: F64, intervals: F64, tick_s: float, median: float) -> float | None:
    """Interval, s, of the even grid that stamps (n,), rounded to ``tick_s``, would come from: the slope of a line
    through them; None where their ``intervals`` (n - 1,), of median ``median``, show frames left out."""
    if np.ptp(intervals) <= 1e-6 * median:
        return float(np.mean(intervals))
    if tick_s <= median < FINE_TICKS * tick_s:
        multiple = np.rint(intervals / median)
        is_whole = multiple.min() >= 1.0 and np.all(np.abs(intervals - multiple * median) < 0.5 * tick_s)
        if is_whole and np.mean(multiple == 1.0) > MOSTLY:
            # of an interval that is no whole number of ticks, others would come, or these more often
            return None
    return float(np.polyfit(np.arange(stamp_s.size), stamp_s, 1)[0])


def _is_serial(intervals: F64) -> bool:
    """Whether neighbouring intervals (n,) are more alike than chance makes them: Bartels' rank test at 1 in 10,000."""
    n = intervals.size
    _, place, count = np.unique(intervals, return_inverse=True, return_counts=True)
    # equal intervals share the mean of their ranks
    rank = (np.cumsum(count) - 0.5 * (count - 1))[place]
    spread = float(np.sum((rank - rank.mean()) ** 2))
    if n < 4 or spread == 0.0:
        return False
    ratio = float(np.sum(np.diff(rank) ** 2)) / spread
    return (ratio - 2.0) / np.sqrt(20.0 / (5 * n + 7)) < RAMP_SCORE  # Bartels 1982: mean and variance


def _pace_ratio(intervals: F64) -> float:
    runs = max(1, intervals.size // RUN)
    local = [float(np.median(part)) for part in np.array_split(intervals, runs)]
    return max(local) / min(local)


def frame_times_at_rate(film: FrameSource, frame_rate_hz: float) -> F64:
    """Times (n_frames,), s, of a film taken at a rate, the middles of exposure: the camera's own where it wrote them (a
    rate that contradicts them is refused), else even, or the file's uneven stamps scaled, with a warning.

    Parameters
    ----------
    film : FrameSource
    frame_rate_hz : float
        True rate, frames/s.

    Returns
    -------
    ndarray, shape (n_frames,)
        Middle of each exposure, s. The camera's own times where it wrote them. Else evenly spaced, or with the
        pattern of the file's stamps where they are uneven (`VisionWarning` with both rates).

    Raises
    ------
    VisionInputError
        A rate that is no positive number, or contradicts the times that the camera wrote; stamps of a slow-motion ramp.

    Examples
    --------
    >>> import vision
    >>> with vision.open_film("film.mraw") as film:
    ...     vision.frame_times_at_rate(film, 2000.0)[:3]
    array([6.2500e-05, 5.6250e-04, 1.0625e-03])
    """
    if not 0.0 < frame_rate_hz < 1e9:
        raise VisionInputError(f"{film.path}: frame rate {frame_rate_hz:g} Hz; needs a positive number")
    own = film.frame_time_s
    if own is not None and getattr(film, "has_camera_times", False):
        _compare_with_camera(film, own, frame_rate_hz)
        return own
    first, half = getattr(film, "first_frame", 0), 0.5 * (film.exposure_s or 0.0)
    even = (first + np.arange(film.n_frames)) / frame_rate_hz + half
    if own is None or film.n_frames < 2:
        return even
    spacing = film_spacing(film, own)
    if spacing.kind == "even":
        return even
    scale = 1.0 / (frame_rate_hz * spacing.interval_s)
    warnings.warn(
        f"{film.path}: its time stamps are uneven ({describe_spacing(spacing, first)}) and run at "
        f"{1.0 / spacing.interval_s:.6g} frames/s, {frame_rate_hz:.6g} are stated: they keep their pattern, "
        f"times {scale:.6g}",
        VisionWarning,
        stacklevel=3,
    )
    return (own - half) * scale + half


def film_spacing(film: FrameSource, time_s: F64) -> Spacing:
    """How a film's own times ``time_s`` (n_frames,) follow one another, as its reader found, else by
    `classify_spacing`; `FilmError` for a slow-motion ramp or times that go back."""
    spacing = getattr(film, "spacing", None)
    if spacing is None:
        try:
            spacing = classify_spacing(time_s, 0.0)
        except FilmError as error:
            raise FilmError(f"{film.path}: {error}; export the film again") from None
    if spacing.kind == "ramp":
        refuse_ramp(film.path, time_s)
    return spacing


def refuse_ramp(path: Path, time_s: F64) -> None:
    """Raise `FilmError` for a film whose times (n,), s, are a slow-motion ramp, with its slowest and fastest pace,
    frames/s."""
    paces = [np.median(part) for part in np.array_split(np.diff(time_s), max(1, (time_s.size - 1) // RUN))]
    raise FilmError(
        f"{path}: its time stamps change pace, from {1.0 / max(paces):.4g} to {1.0 / min(paces):.4g} frames/s, as "
        "slow-motion ramps of play-back do; no constant factor gives true times: export it without the ramp, or track "
        "a part of one pace (`first_frame`, `last_frame`)"
    )


def describe_spacing(spacing: Spacing, first_frame: int) -> str:
    gaps = np.flatnonzero(spacing.missing)
    if gaps.size == 0:
        return "variable rate"
    where = f"{'first ' if gaps.size > 1 else ''}after frame {gaps[0] + first_frame}"
    return f"{int(spacing.missing.sum())} frames missing in {gaps.size} gap{'s' if gaps.size > 1 else ''}, {where}"


def _compare_with_camera(film: FrameSource, time_s: F64, frame_rate_hz: float) -> None:
    """Raise `FilmError` where a stated rate differs from that of the camera's own times (n,), s, by more than 1e-4 of
    it and 1 us over the film, or where these times lack frames."""
    if time_s.size < 2:
        return
    intervals = np.diff(time_s)
    multiple = np.maximum(np.rint(intervals / np.median(intervals)), 1.0).astype(np.int64)
    saved = float(multiple.sum() / intervals.sum())
    # stamps of a camera are rounded to a microsecond at worst
    allowed = CLOCKS_AGREE + 1e-6 / float(intervals.sum())
    header, words = film.frame_rate_hz, ""
    if header is not None and header > 1.5 * saved:
        words = f" (it took {header:.6g} and saved every {round(header / saved)}th)"
    if abs(frame_rate_hz - saved) <= allowed * saved:
        if multiple.max() == 1:
            return
        words = f", and {describe_spacing(Spacing('gaps', 1.0 / saved, multiple - 1), getattr(film, 'first_frame', 0))}"
    raise FilmError(
        f"{film.path}: a rate of {frame_rate_hz:.9g} frames/s is stated, the camera's own times say "
        f"{saved:.9g}{words}; leave out the rate (`frame_rate_hz`): its own times are used"
    )


def count_missing_frames(time_s: F64) -> dict[int, int]:
    """Frames missing in times (n,), s: their number by the index of the frame before the gap; empty for fewer than
    three times and where more are missing than there are. `FilmError` for times that go back."""
    if time_s.size < 3:
        return {}
    missing = classify_spacing(time_s, 0.0).missing
    if missing.sum() > time_s.size:
        return {}
    return {int(at): int(missing[at]) for at in np.flatnonzero(missing)}


def warn_of_uneven_times(film: FrameSource, time_s: F64) -> None:
    """Warn (`VisionWarning`) where the times (n,), s, that are used for a film lack frames, change pace, or have an
    interval above twice their median; silent for fewer than three."""
    if time_s.size < 3:
        return
    spacing = classify_spacing(time_s, 0.0)
    if spacing.missing.any():
        words = describe_spacing(spacing, getattr(film, "first_frame", 0))
        words += ", as their times say; nothing is known of the motion there (in tables: rows of frame -1, flag 16384)"
    elif spacing.kind == "ramp":
        words = "frames follow at a pace that changes; where it is that of play-back, give the true times"
    elif (longest := float(np.diff(time_s).max())) > LONG * spacing.interval_s:
        at = int(np.argmax(np.diff(time_s))) + getattr(film, "first_frame", 0)
        words = (
            f"frames follow unevenly: {1e3 * longest:.4g} ms after frame {at}, {1e3 * spacing.interval_s:.4g} ms in "
            "the median; nothing is known of the motion between"
        )
    else:
        return
    warnings.warn(f"{film.path}: {words}", VisionWarning, stacklevel=4)
