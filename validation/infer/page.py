"""The reading of an identification: one page without outside addresses, plain sentences first.

Sentences, tables and figures are filled into ``page.html.j2``, with the report's style and parts.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup, escape
from matplotlib import rc_context
from matplotlib.figure import Figure

from validation.conventions import ENCODER_CHANNELS, Array
from validation.infer.estimates import IDENTIFIED, Profile
from validation.infer.fit import Fitted
from validation.infer.further import Prospect
from validation.infer.identifiability import CANNOT_TELL
from validation.infer.lacks import telling
from validation.infer.observations import CHANNEL_NAMES, ObservedTrial
from validation.infer.result import FITTED, Identification
from validation.infer.scatter import factors
from validation.infer.scores import CEILING, NULL, SHOWN, EventScore, event_words
from validation.infer.unknowns import Parameter
from validation.report.figures.svg import STYLE, figure_svg
from validation.report.page import style_text, templates
from validation.tables.numbers import DASH, number
from validation.tables.table import PageTable

SPEED = "hammer_speed"
EVEN = 0.05  # of a ratio of two scores: closer than that is as good
WHO = (("identified", "with the identified values"), ("before", "with those before"), (NULL, "by the null model"))


def plain_sentences(found: Identification, ranked: Sequence[Prospect] = ()) -> list[str]:
    """The sentences at the head of the page.

    Parameters
    ----------
    ranked : what could be recorded next; empty where it was not asked for
    """
    said = [_what_was_found(found), *found.details.explained]
    said += [
        f"These strokes cannot tell the size of {d.words}: {100 * d.left:.0f} % of its prior u is left."
        for d in found.undetermined
    ][:3]
    said += _held_out(found)
    said.append(_next(ranked, found.details.fitted.converged))
    return said + (_apart(found, ranked) if ranked else [])


def _apart(found: Identification, ranked: Sequence[Prospect]) -> list[str]:
    """Which stroke tells best what is lacking, where several changes take it away."""
    known = found.details.supported
    strokes = [p for p in ranked if p.candidate is not None]
    if known is None or len(known.let_in) < 2 or not strokes:
        return []
    apart = telling(known.let_in, [p.candidate.trial for p in strokes if p.candidate is not None])
    best = int(np.argmax(apart))
    return [
        f"What is lacking is told best by {prospect_words(strokes[best])}: the fits that explain these strokes alike "
        f"differ there by {apart[best]:.0f} times the sensors' noise."
    ]


def _what_was_found(found: Identification) -> str:
    n, trials = len(found.estimates), len(found.details.problem.trials)
    of = f"{_count(trials, 'trial')} of {_count(len(found.details.problem.seen), 'session')}"
    made = f"{_count(n, 'parameter')} {'was' if n == 1 else 'were'} asked of {of}: "
    known = [e for e in found.estimates if e.verdict == IDENTIFIED]
    if not known:
        return made + "no value is called identified; the table says why for each."
    named = ", ".join(f"{e.name} {number(e.value, 3)} (u {number(e.u, 2)})" for e in known)
    rest = len(found.estimates) - len(known)
    return made + f"{len(known)} called identified ({named})" + (f", {rest} not." if rest else ".")


def _held_out(found: Identification) -> list[str]:
    held = [name for name in found.scores if name != FITTED]
    if not held:
        return ["Nothing was held out: how well the fitted strokes are met is no prediction. Use --hold-out."]
    said = []
    for name in held:
        by = found.events.get(name)
        curve = _curve_words(found.scores[name])
        if by is None:  # the key drives: it has no events of its own
            said.append(f"Predicted under the measured motion of the key, not fitted, {name}:{curve}")
        else:
            said.append(f"Predicted, not fitted, {name}: {_speed(by)}{curve}")
    return said


def _speed(by: Mapping[str, Mapping[str, EventScore]]) -> str:
    """How far the hammer's speed is off, as a sentence."""
    title, factor, unit = event_words(SPEED)
    parts = []
    for who, words in WHO:
        score = by[who][SPEED]
        if math.isfinite(score.rms):
            seen = "" if score.both == score.trials else f" (where it strikes: {score.both} of {score.trials} trials)"
            parts.append(f"{number(factor * score.rms, 2)} {unit} {words}{seen}")
    ceiling = by[CEILING][SPEED].rms
    if math.isfinite(ceiling):
        parts.append(f"the trials themselves scatter by {number(factor * ceiling, 2)} {unit}")
    return f"{title.lower()} off by (RMS) {', '.join(parts)}." if parts else f"{title.lower()} is not known there."


def _curve_words(scores: Mapping[str, Mapping[str, float] | None]) -> str:
    """The same of the hammer's curve, and whether the values identified are better than those before."""
    parts = [
        f"{number(1e3 * by['hammer'], 2)} mrad {words}"
        for who, words in (*WHO, ("scatter of trials", "is the scatter of the trials"))
        if (by := scores.get(who)) is not None
    ]
    before, after = scores.get("before"), scores.get("identified")
    judged = ""
    if before is not None and after is not None:
        ratio = after["hammer"] / before["hammer"]
        what = "no better than" if abs(ratio - 1.0) < EVEN else "better than" if ratio < 1.0 else "worse than"
        judged = f" The identified values predict the curve {what} those before."
    return f" Hammer curve off by (RMS) {', '.join(parts)}.{judged}" if parts else ""


def _next(ranked: Sequence[Prospect], settled: bool) -> str:
    if not ranked:
        return "What to record next was not asked for; --plan plan.toml ranks the strokes on the shelf."
    best = ranked[0]
    doubt = "" if settled else "; but the fit it is predicted from ran out of its budget"
    most = min(best.shrink, key=lambda name: best.shrink[name])
    return (
        f"Next: {prospect_words(best)} would shrink u to {100 * best.mean:.0f} % on average, that of {most} to "
        f"{100 * best.shrink[most]:.0f} % (predicted{doubt})."
    )


def prospect_words(p: Prospect) -> str:
    """What could be done next, in words: so many trials of a stroke, so many more of a session, a sensor."""
    if p.candidate is None:
        return p.name
    return f"{p.trials} {p.name}" if p.candidate.profile is None else f"{p.trials} trials of {p.name}"


def as_sentence(line: str) -> str:
    """A line with a full stop, and with a capital where it does not begin with a name or a number."""
    first = line.split(" ")[0]
    head = line[0].upper() if first.isalpha() else line[0]
    return f"{head}{line[1:]}{'' if line.endswith('.') else '.'}"


def together(refused: Sequence[str]) -> list[str]:
    """Lines ``name: reason`` with the names of one reason in one line."""
    names: dict[str, list[str]] = {}
    for line in refused:
        name, _, reason = line.partition(": ")
        names.setdefault(reason, []).append(name)
    return [f"{', '.join(of)}: {reason}" for reason, of in names.items()]


def _count(n: int, word: str) -> str:
    return f"{n} {word}{'' if n == 1 else 's'}"


PRIOR_REACH = 1.96
WIDTH, EDGE = 240.0, 8.0
CLASSES = ((0.3, "h0"), (0.5, "h1"), (0.7, "h2"), (0.9, "h3"), (math.inf, "h4"))
"""Upper end of each class of colour of a correlation, absolute."""
MOST_NEXT = 12


def z_of(parameter: Parameter, prior: float, value: float) -> float:
    """A value in prior standard uncertainties from the prior's."""
    if not parameter.factor:
        return (value - prior) / parameter.u
    return math.log(max(value / prior, 1e-9)) / parameter.u


def forest(found: Identification) -> list[dict[str, Any]]:
    """One row of each asked parameter, in the order asked: texts, and places in the drawing's own units."""
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
            dict(
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


BEFORE, AFTER = "#b35900", "#00508c"
WIDTH_IN, ROW_IN = 9.2, 2.1
ACROSS = 4


def residual_figure(trials: Sequence[ObservedTrial], before: Sequence[Array], after: Sequence[Array]) -> str:
    """SVG of the root mean square difference of each session and channel over the phases of the stroke."""
    one, two = residual_rms(trials, before), residual_rms(trials, after)
    with rc_context(STYLE):
        figure = Figure(figsize=(WIDTH_IN, ROW_IN * len(one) + 0.5), layout="constrained")
        shown = sorted({c for t in trials for c in t.channels})
        grid = figure.subplots(len(one), len(shown), squeeze=False)
        for row, session in zip(grid, one, strict=True):
            first = next(t for t in trials if t.session == session)
            label = first.label.rpartition(", trial")[0]
            for axes, channel in zip(row, shown, strict=True):
                axes.set_title(f"{CHANNEL_NAMES[channel]}, {label}", fontsize=9)
                if channel not in first.channels:
                    axes.set_axis_off()
                    continue
                time, c = one[session][0], first.channels.index(channel)
                axes.plot(time, 1e3 * one[session][1][:, c], color=BEFORE, lw=1.1, ls="--", label="before")
                axes.plot(time, 1e3 * two[session][1][:, c], color=AFTER, lw=1.3, label="after the fit")
                axes.set_yscale("log")
                axes.grid(alpha=0.25)
                axes.set_xlabel("time, s")
            row[0].set_ylabel("RMS, mrad")
        next(axes for axes in grid[0] if axes.lines).legend(fontsize=8, frameon=False)
        return figure_svg(
            figure,
            "residuals",
            "Difference of model and trials by phase, before and after the fit",
            "Root mean square over the trials of each session, in milliradians, by channel; the table below says the "
            "same by phase.",
            (0.0, 0.0),
        )


def profile_figure(profiles: Sequence[Profile], fitted: Fitted, names: Sequence[str]) -> str:
    """SVG of the profiles: how the fit worsens when one parameter is held elsewhere; empty where none was made."""
    if not profiles:
        return ""
    level = dict(zip(names, factors(fitted) ** 2, strict=False))
    rows = math.ceil(len(profiles) / ACROSS)
    with rc_context(STYLE):
        figure = Figure(figsize=(WIDTH_IN, ROW_IN * rows + 0.3), layout="constrained")
        grid = figure.subplots(rows, ACROSS, squeeze=False).ravel()
        for axes, p in zip(grid, profiles, strict=False):
            axes.plot(p.z, p.rise, color=AFTER, lw=1.2, marker="o", ms=3)
            axes.axhline(level[p.name], color=BEFORE, lw=0.9, ls="--")
            axes.axvspan(p.low, p.high, color=AFTER, alpha=0.12, lw=0)
            axes.set_ylim(min(0.0, float(np.min(p.rise))) - 0.5, 3.0 * level[p.name])
            axes.set_title(p.name.removesuffix(".A"), fontsize=8)
            axes.grid(alpha=0.25)
        for axes in grid[len(profiles) :]:
            axes.set_visible(False)
        for axes in grid[::ACROSS]:
            axes.set_ylabel("rise")
        figure.supxlabel("prior standard uncertainties from the prior's value", fontsize=9)
        return figure_svg(
            figure,
            "profiles",
            "Profile of each parameter",
            "Rise of twice the negative log posterior when one parameter is held at other values and all else is "
            "fitted again; dashed the level of the 95 % interval, shaded the interval.",
            (0.0, 0.0),
        )


HERE = Path(__file__).parent


def render_identification(found: Identification, ranked: Sequence[Prospect] = (), refused: Sequence[str] = ()) -> str:
    """The page of an identification, without scripts or outside addresses.

    Parameters
    ----------
    found : Identification
    ranked : what could be recorded next; empty where it was not asked for
    refused : what was not considered for it, and why

    Returns
    -------
    str
        HTML.

    Examples
    --------
    >>> import validation
    >>> found = validation.identify(["sessions/example_forte"], ["hammer.joint_friction"], profiles=())
    >>> "hammer.joint_friction" in validation.render_identification(found)
    True
    """
    environment = templates(HERE, HERE.parent / "report")
    environment.filters["breakable"] = breakable
    problem, fitted = found.details.problem, found.details.fitted
    before = problem.response.curves([np.zeros(len(problem.unknowns.moved))])[0] or fitted.curves
    names = [e.name for e in found.estimates]
    return environment.get_template("page.html.j2").render(
        found=found,
        made=found.provenance["created_utc"],
        style=style_text(),
        # what the strokes cannot tell is said in a section of its own
        warnings=[as_sentence(line) for line in found.warnings if not line.startswith(CANNOT_TELL)],
        sentences=plain_sentences(found, ranked),
        forest=forest(found),
        names=names,
        correlations=correlations(found),
        profiles=Markup(profile_figure(found.details.profiles, fitted, names)),
        residuals=Markup(residual_figure(problem.trials, before, fitted.curves)),
        residuals_table=residuals_table(problem.trials, before, fitted.curves),
        held_out=held_out_tables(found),
        next=next_table(ranked),
        refused=together(refused),
        provenance=_flat(found.provenance),
    )


def breakable(name: str) -> Markup:
    """A name that a narrow column may break after a dot or an underscore, and is copied without it."""
    return Markup(escape(name).replace(".", Markup(".<wbr>")).replace("_", Markup("_<wbr>")))


def _flat(value: Mapping[str, Any], prefix: str = "") -> list[tuple[str, str]]:
    rows: list[tuple[str, str]] = []
    for key, item in value.items():
        if isinstance(item, Mapping):
            rows += _flat(item, f"{prefix}{key}: ")
        else:
            rows.append((f"{prefix}{key}", item if isinstance(item, str) else json.dumps(item, ensure_ascii=False)))
    return rows
