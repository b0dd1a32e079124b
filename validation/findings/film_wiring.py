"""A film that is mirrored, or whose bodies stand in each other's place.

Conventions: angles relative to the whippen and to rest. Jack and repetition lever are compared, in both places and
senses, with their prediction, the whippen with its encoder. A mirrored film turns every angle round; that is named
only when all bodies agree. Silent where the model is further off than a quarter of the motion.
"""

from __future__ import annotations

import numpy as np

from validation.conventions import FILM_CHANNELS, WHIPPEN
from validation.events.encoder_wiring import best_wiring
from validation.findings.finding import SessionFinding
from validation.measurement.trial import MeasuredTrial
from validation.prediction.trial_prediction import PredictedAngles

MIRRORED = -0.5  # regression of the film's whippen on the encoder's, −1 in a mirrored film
FEWEST_FRAMES = 20
SCALES_MAY = 0.05  # also what a late film does to the regression


def film_wiring(m: MeasuredTrial, p: PredictedAngles, *, whippen_sound: bool) -> list[SessionFinding]:
    """Bodies of a film that turn the wrong way round or stand in each other's place, or move by another scale.

    The whippen is compared where its encoder is sound.
    """
    film = m.film
    if film is None:
        return []
    whippen = _regression(m) if whippen_sound else float("nan")
    measured = np.column_stack([film.change_rad[name] for name in FILM_CHANNELS])
    expected = np.column_stack([p.change_at(name, film.time_s) for name in FILM_CHANNELS])
    wrong = {FILM_CHANNELS[w.place]: w for w in best_wiring(measured, expected)}
    swapped = {name: FILM_CHANNELS[w.source] for name, w in wrong.items() if w.source != w.place}
    turned = [name for name, w in wrong.items() if w.reversed]
    out = []
    if swapped:
        text = (
            f"trial {m.number}: film: "
            + ", ".join(f"what is tracked as {source} moves as the {name} should" for name, source in swapped.items())
            + "; bodies are swapped, correct the outlines' names and track again"
        )
        out.append(SessionFinding("film bodies swapped", m.number, "film", float(len(swapped)), 0.0, text))
    seen = len(turned) == len(FILM_CHANNELS)
    if (whippen < MIRRORED and (seen or not turned)) or (np.isnan(whippen) and seen):
        text = (
            f"trial {m.number}: film: all bodies turn the wrong way round: the film is mirrored, or was seen from the "
            f"other "
            "side; mirror it and track again"
        )
        out.append(SessionFinding("film mirrored", m.number, "film", whippen, MIRRORED, text))
    elif turned:
        text = f"trial {m.number}: film: {' and '.join(turned)} turn the wrong way round; check the outlines"
        out.append(SessionFinding("film body reversed", m.number, turned[0], float(len(turned)), 0.0, text))
    if not out and abs(whippen - 1) > SCALES_MAY:
        text = (
            f"trial {m.number}: film: its whippen moves {whippen:.3f} times as far as the encoder's (limit "
            f"{100 * SCALES_MAY:g} %): the scale of one of them is wrong, or the film is seen at an angle"
        )
        out.append(SessionFinding("film or encoder scale", m.number, "film", whippen, SCALES_MAY, text))
    return out


def _regression(m: MeasuredTrial) -> float:
    """Slope of the film's whippen on the encoder's; NaN where the film does not show it."""
    film = m.film
    if film is None or film.whippen_rad is None:
        return float("nan")
    encoder = np.interp(film.time_s, m.time_s, m.change_rad[:, WHIPPEN])
    known = np.isfinite(film.whippen_rad)
    if known.sum() < FEWEST_FRAMES or not np.ptp(encoder[known]) > 0:
        return float("nan")
    return float(np.polyfit(encoder[known], film.whippen_rad[known], 1)[0])
