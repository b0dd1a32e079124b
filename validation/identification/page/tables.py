"""Tables of the page: the forest of priors and posteriors, correlations, residuals by phase, held-out scores, next."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from validation.conventions import ENCODER_CHANNELS, Array
from validation.identification.further.shrink import Prospect
from validation.identification.observations import CHANNEL_NAMES, ObservedTrial
from validation.identification.outcome.held_out import CEILING, NULL, SHOWN, event_words
from validation.identification.outcome.result import FITTED, IDENTIFIED, Identification
from validation.identification.page.sentences import prospect_words
from validation.identification.unknowns.priors import Parameter
from validation.report.tables.formatting import DASH, PageTable, number

PRIOR_REACH = 1.96
WIDTH, EDGE = 240.0, 8.0
CLASSES = ((0.3, "h0"), (0.5, "h1"), (0.7, "h2"), (0.9, "h3"), (math.inf, "h4"))
"""Upper end of each class of colour of a correlation, absolute."""
MOST_NEXT = 12


@dataclass(frozen=True)
class ForestRow:
    """One parameter; places are of the drawing, in its own units."""

    name: str
    value: str
    interval: str
    prior: str
    left: str
    left_out: str
    verdict: str
    identified: bool
    prior_low: float
    prior_high: float
    low: float
    high: float
    at: float


def z_of(parameter: Parameter, prior: float, value: float) -> float:
    """A value in prior standard uncertainties from the prior's."""
    if not parameter.factor:
        return (value - prior) / parameter.u
    return math.log(max(value / prior, 1e-9)) / parameter.u


def forest(found: Identification) -> list[ForestRow]:
    """One row of each asked parameter, in the order asked."""
    asked = found.details.problem.unknowns.asked
    ends = [(z_of(p, e.prior, e.low), z_of(p, e.prior, e.high)) for p, e in zip(asked, found.estimates, strict=True)]
    reach = max(PRIOR_REACH, *(abs(x) for pair in ends for x in pair)) * 1.05

    def place(z: float) -> float:
        return round(WIDTH / 2 + (WIDTH / 2 - EDGE) * z / reach, 2)

    rows = []
    for (low, high), p, e in zip(ends, asked, found.estimates, strict=True):
        unit = "" if e.unit == "1" else f" {e.unit}"
        u = f"{100 * p.u:.0f} %" if p.factor else f"{number(p.u, 2)}{unit}"
        open_ = "" if e.interval == "two-sided" else f"; without the prior {e.interval}"
        rows.append(
            ForestRow(
                name=e.name,
                value=f"{number(e.value, 4)} (u {number(e.u, 2)})",
                interval=f"{number(e.low, 4)} to {number(e.high, 4)}",
                prior=f"{number(e.prior, 4)}{unit} (u {u})",
                left=number(e.z_u, 2),
                left_out=f"{number(e.u_jackknife, 2)} / {number(e.u_strokes, 2)}",
                verdict=e.verdict + open_,
                identified=e.verdict == IDENTIFIED,
                prior_low=place(-PRIOR_REACH),
                prior_high=place(PRIOR_REACH),
                low=place(low),
                high=place(high),
                at=place(e.z),
            )
        )
    return rows


def correlations(found: Identification) -> list[tuple[str, list[tuple[str, str]]]]:
    """Rows of the correlation map: name, and number with class of colour of each cell; the diagonal is empty."""
    names = [e.name for e in found.estimates]
    rows = []
    for i, name in enumerate(names):
        cells = []
        for j in range(len(names)):
            value = float(found.correlation[i, j])
            level = next(c for most, c in CLASSES if abs(value) <= most)
            cells.append(("", "na") if i == j else (f"{value:+.2f}".replace("-", "−"), level))
        rows.append((name, cells))
    return rows


def residual_rms(trials: Sequence[ObservedTrial], curves: Sequence[Array]) -> dict[int, tuple[Array, Array]]:
    """Session -> times of its first trial (m,) and RMS difference of its trials (m, c), rad, 0 where lost."""
    found = {}
    for session in sorted({t.session for t in trials}):
        own = [(t, c) for t, c in zip(trials, curves, strict=True) if t.session == session]
        apart = np.array([t.change_rad - c for t, c in own])
        square = np.nansum(apart**2, axis=0) / np.maximum(np.isfinite(apart).sum(axis=0), 1)
        found[session] = own[0][0].time_s, np.sqrt(square)
    return found


def residuals_table(trials: Sequence[ObservedTrial], before: Sequence[Array], after: Sequence[Array]) -> PageTable:
    """Root mean square differences while the hammer rises and after it, before and after the fit, mrad."""
    one, two = residual_rms(trials, before), residual_rms(trials, after)
    shown = sorted({c for t in trials for c in t.channels})
    rows = []
    for session, (time, rms) in one.items():
        first = next(t for t in trials if t.session == session)
        hammer = np.abs(first.column("hammer"))
        up = time <= time[int(np.argmax(hammer > 0.9 * hammer.max()))]
        for phase, inside in (("until the hammer is up", up), ("after", ~up)):
            if not inside.any():
                continue
            cells = [
                f"{number(1e3 * _rms(rms[inside, k]), 2)} → {number(1e3 * _rms(two[session][1][inside, k]), 2)}"
                if (k := first.channels.index(c) if c in first.channels else -1) >= 0
                else DASH
                for c in shown
            ]
            rows.append([first.label.rpartition(", trial")[0], phase, *cells])
    head = ["session", "phase", *(CHANNEL_NAMES[c] for c in shown)]
    return PageTable("residuals", "Difference of model and trials, RMS, mrad: before → after the fit", head, rows)


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def held_out_tables(found: Identification) -> list[PageTable]:
    """Events and curves of each set of trials that was not fitted."""
    tables = []
    for i, name in enumerate(name for name in found.scores if name != FITTED):
        rows, by = [], found.events.get(name, {})
        for event in SHOWN if by else ():
            title, factor, unit = event_words(event)
            cells = [_score(by[who][event], factor) for who in ("identified", "before", NULL)]
            rows.append([f"{title}, {unit}", *cells, number(factor * by[CEILING][event].rms, 2)])
        curves = found.scores[name]
        for channel in (name for name in CHANNEL_NAMES if name in (curves["before"] or ENCODER_CHANNELS)):
            cells = [_curve(curves.get(who), channel) for who in ("identified", "before", "null model")]
            rows.append([f"{channel} curve, mrad", *cells, _curve(curves.get("scatter of trials"), channel)])
        head = ["RMS of model − trial", "identified", "before", "null model", "scatter of the trials"]
        tables.append(PageTable(f"held-{i}", f"Predicted, not fitted: {name}", head, rows))
    return tables


def _score(score: object, factor: float) -> str:
    rms, both, trials = (getattr(score, name) for name in ("rms", "both", "trials"))
    if not trials:
        return DASH
    return f"{number(factor * rms, 2)} in {both} of {trials}"


def _curve(by_channel: dict[str, float] | None, channel: str) -> str:
    return DASH if by_channel is None or channel not in by_channel else number(1e3 * by_channel[channel], 2)


def next_table(ranked: Sequence[Prospect]) -> PageTable | None:
    """What could be done next, the best first; None where it was not asked for."""
    if not ranked:
        return None
    names = list(ranked[0].shrink)
    rows = [[prospect_words(p), f"{p.mean:.2f}", *(f"{p.shrink[n]:.2f}" for n in names)] for p in ranked[:MOST_NEXT]]
    notes = [
        "u after, over u now, as the Fisher information at these values predicts; what the strokes would teach about "
        "the sizes of noise and of the discrepancy is not in it: where the model lacks something, realised shrinks "
        "were off by up to a factor of two on the virtual bench.",
    ]
    return PageTable("next", "What to record next, or know better", ["", "mean", *names], rows, notes)
