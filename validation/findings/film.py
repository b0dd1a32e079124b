"""Faults of a film: mirrored, bodies in each other's place, a clock that is off or runs away."""

from __future__ import annotations

import numpy as np

from rig.session.force_correction import correlation_inflation
from validation.conventions import FILM_CHANNELS, SIGMAS, WHIPPEN, Array
from validation.events.miswired_encoders import STILL, find_best_wiring
from validation.findings.finding import CURVES, SessionFinding, register_kinds
from validation.findings.limits import SCALES_MAY
from validation.measurement.trial import FilmAngles, MeasuredTrial
from validation.prediction.predict_session import PredictedAngles

CLOCK_S = 1e-4  # choice: a tenth of a frame at 1000/s
RUNS_AWAY_S = 3e-4  # choice, between the first and the last motion
LONGEST_STEP_S = 5e-3  # of the search for a delay: some frames, within which the motion is straight
FEWEST_FRAMES = 10  # that a delay, a zero and a scale are fitted to


@register_kinds(
    {
        "film time offset": "Check trigger frame, exposure and delay of the camera.",
        "film time drift": "Check the camera's rate and look for lost frames.",
    },
    spoils=CURVES,
)
def check_camera_clock(m: MeasuredTrial) -> list[SessionFinding]:
    """Finding that the film's times drift against the DAQ clock or are off it, by the whippen that film and encoder
    both see; empty if none."""
    film = m.film
    if film is None or film.whippen_rad is None:
        return []
    return find_clock_drift(m, film, film.whippen_rad) or find_clock_offset(m, film, film.whippen_rad)


def find_clock_offset(m: MeasuredTrial, film: FilmAngles, whippen_rad: Array) -> list[SessionFinding]:
    """One finding where the film shows the whippen more than 0.1 ms, and three standard uncertainties, later (value >
    0, s) or earlier than its encoder, else none; ``whippen_rad`` (frames,): the film's whippen angle, NaN where lost.
    """
    offset, u = estimate_clock_offset(film.time_s, whippen_rad, m.time_s, m.change_rad[:, WHIPPEN])
    limit = max(CLOCK_S, 3 * float(np.hypot(u, film.u_time_s)))
    if not abs(offset) > limit:
        return []
    side = "later" if offset > 0 else "earlier"
    text = (
        f"trial {m.number}: film: it shows the whippen's motion {1e3 * abs(offset):.2f} ms {side} than its encoder "
        f"(standard uncertainty {1e3 * u:.3f} ms, limit {1e3 * limit:.2f} ms)"
    )
    return [SessionFinding("film time offset", m.number, "film", offset, limit, text)]


def find_clock_drift(m: MeasuredTrial, film: FilmAngles, whippen_rad: Array) -> list[SessionFinding]:
    """One finding where frame times gain (value > 0, s) or lose against the DAQ clock, by more than 0.3 ms and five u,
    between first and second half of the motion, else none; ``whippen_rad`` (frames,): the film's whippen angle, rad.

    Between two motions nothing tells a wrong rate from lost frames: both are named.
    """
    encoder = m.change_rad[:, WHIPPEN]
    speed = np.abs(np.interp(film.time_s, m.time_s, np.gradient(encoder, m.time_s)))
    moving = speed > STILL * float(speed.max(initial=0.0))  # these frames tell the clock
    moves, weight = film.time_s[moving], speed[moving] ** 2
    if moves.size < FEWEST_FRAMES:
        return []
    # the rate is told by where most of the motion is, not by the film's whole length
    middle = 0.5 * float(moves[0] + moves[-1])
    parts = [(-np.inf, middle), (middle, np.inf)]
    found = []
    for low, high in parts:
        here = (film.time_s > low) & (film.time_s <= high)
        found.append(estimate_clock_offset(film.time_s[here], whippen_rad[here], m.time_s, encoder))
    (early, u_early), (late, u_late) = found
    by, u = late - early, float(np.hypot(u_early, u_late))
    limit = max(RUNS_AWAY_S, SIGMAS * u)
    if not (np.isfinite(u) and abs(by) > limit):  # u is not known where too few frames show the motion
        return []
    centre = []
    for low, high in parts:
        here = (moves > low) & (moves <= high)
        centre.append(float(np.average(moves[here], weights=weight[here])))
    frame = float(np.median(np.diff(film.time_s)))
    text = (
        f"trial {m.number}: film: between the strokes down and up its times {'fall' if by < 0 else 'run'} "
        f"{1e3 * abs(by):.2f} ms {'behind' if by < 0 else 'ahead of'} the whippen's encoder (standard "
        f"uncertainty {1e3 * u:.3f} ms, limit {1e3 * limit:.2f} ms): "
        f"{100 * abs(by) / (centre[1] - centre[0]):.2f} % of the time between, or {abs(by) / frame:.0f} frames"
    )
    return [SessionFinding("film time drift", m.number, "film", by, limit, text)]


def estimate_clock_offset(film_s: Array, film_rad: Array, time_s: Array, angle_rad: Array) -> tuple[float, float]:
    """Delay of a film's clock against the encoder's, s, positive when frame times are late, and its standard
    uncertainty (NaN below 10 frames), from one body's angles: ``film_rad`` at frame times ``film_s``, ``angle_rad`` at
    encoder times ``time_s``.

    Least squares of delay, zero and scale by Gauss–Newton; the uncertainty takes neighbouring residuals for dependent.
    """
    speed = np.gradient(angle_rad, time_s)
    delay, u = 0.0, float("nan")
    for _ in range(20):  # at most
        at = film_s - delay
        known = np.isfinite(film_rad) & (at > time_s[0]) & (at < time_s[-1])
        if known.sum() < FEWEST_FRAMES:
            return 0.0, float("nan")
        difference = film_rad[known] - np.interp(at[known], time_s, angle_rad)
        moved = np.interp(at[known], time_s, angle_rad)
        design = np.column_stack([np.ones(known.sum()), -np.interp(at[known], time_s, speed), moved - moved.mean()])
        value, *_ = np.linalg.lstsq(design, difference, rcond=None)
        residual = difference - design @ value
        variance = float(residual @ residual) / max(known.sum() - 3, 1) * correlation_inflation(residual)
        u = float(np.sqrt(variance * np.linalg.pinv(design.T @ design)[1, 1]))
        delay += float(np.clip(value[1], -LONGEST_STEP_S, LONGEST_STEP_S))
        if abs(value[1]) < 1e-9:
            break
    return delay, u


MIRRORED = -0.5  # regression of the film's whippen on the encoder's, −1 in a mirrored film


@register_kinds(
    {
        "film mirrored": "Mirror the film and track it again.",
        "film bodies swapped": "Correct the names of the outlines and track the film again.",
        "film body reversed": "Check the outlines and track the film again.",
        "film travel difference": "Check the scale of the whippen's encoder and of the film.",
    }
)
def find_miswired_film(m: MeasuredTrial, p: PredictedAngles, *, whippen_sound: bool) -> list[SessionFinding]:
    """Findings of a mirrored film, of jack and repetition lever swapped or reversed, or of a whippen more than 5 % off
    its encoder in scale; empty without film. ``whippen_sound``: whether the whippen's encoder may be compared.

    Conventions: angles relative to the whippen and to rest. Jack and repetition lever are compared, in both places and
    senses, with their prediction, the whippen with its encoder. A mirrored film turns every angle round; that is named
    only when all bodies agree. Silent where the model is further off than a quarter of the motion.
    """
    film = m.film
    if film is None:
        return []
    whippen = _fit_whippen_slope(m) if whippen_sound else float("nan")
    measured = np.column_stack([film.change_rad[name] for name in FILM_CHANNELS])
    expected = np.column_stack([p.change_at(name, film.time_s) for name in FILM_CHANNELS])
    wrong = {FILM_CHANNELS[w.place]: w for w in find_best_wiring(measured, expected)}
    swapped = {name: FILM_CHANNELS[w.source] for name, w in wrong.items() if w.source != w.place}
    turned = [name for name, w in wrong.items() if w.reversed]
    out = []
    if swapped:
        text = (
            f"trial {m.number}: film: "
            + ", ".join(f"what is tracked as {source} moves as the {name} should" for name, source in swapped.items())
            + " (swapped bodies), in motion and at rest"
        )
        out.append(SessionFinding("film bodies swapped", m.number, "film", float(len(swapped)), 0.0, text))
    seen = len(turned) == len(FILM_CHANNELS)
    if (whippen < MIRRORED and (seen or not turned)) or (np.isnan(whippen) and seen):
        text = f"trial {m.number}: film: all bodies turn the other way round than their encoder and prediction"
        out.append(SessionFinding("film mirrored", m.number, "film", whippen, MIRRORED, text))
    elif turned:
        text = f"trial {m.number}: film: {' and '.join(turned)} turn the other way round than predicted"
        out.append(SessionFinding("film body reversed", m.number, turned[0], float(len(turned)), 0.0, text))
    if not out and abs(whippen - 1) > SCALES_MAY:
        text = (
            f"trial {m.number}: film: its whippen moves {whippen:.3f} times as far as the encoder's (limit "
            f"{100 * SCALES_MAY:g} %)"
        )
        out.append(SessionFinding("film travel difference", m.number, "film", whippen, SCALES_MAY, text))
    return out


def _fit_whippen_slope(m: MeasuredTrial) -> float:
    """Regression slope of the film's whippen angle on the encoder's, 1 where both agree; NaN without film, where it
    does not show the whippen, or where fewer than 10 frames do."""
    film = m.film
    if film is None or film.whippen_rad is None:
        return float("nan")
    encoder = np.interp(film.time_s, m.time_s, m.change_rad[:, WHIPPEN])
    known = np.isfinite(film.whippen_rad)
    if known.sum() < FEWEST_FRAMES or not np.ptp(encoder[known]) > 0:
        return float("nan")
    return float(np.polyfit(encoder[known], film.whippen_rad[known], 1)[0])
