"""The page and the files of a comparison of positions: ``report.html``, ``results.json``, ``curves/trial_NNNN.csv``."""

from __future__ import annotations

import io
import json
import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from markupsafe import Markup
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import model
from rig.session import Session
from validation.events.strikes import EVENTS, find_phases
from validation.infer.scatter import jackknife_u
from validation.measurement.positions import Stroke
from validation.pipeline.compare_positions import ENDING, PositionComparison, Predicted, compare_positions
from validation.prediction.positions import FREE, values_of
from validation.report.figures.svg import STYLE, figure_svg
from validation.report.files import check_folder, write_files
from validation.report.page import style_text, templates
from validation.report.write import records
from validation.statistics.skill import CALLED

COLOURS = {"identified": "#00508c", "regulated": "#b35900", "null": "#6b6b6b"}
SIZE_IN = (9.2, 5.4)
MOST_POINTS = 450
AROUND_STRIKE_S, AROUND_RELEASE_S = (0.1, 0.15), (0.1, 0.45)


OUTSIDE = ", outside of what was fitted"


def stroke_figure(stroke: Stroke, predicted: Sequence[Predicted], outside: bool = False) -> str:
    """One stroke as SVG: the whole above, strike and release below; its title says where it lies outside."""
    with rc_context(STYLE):
        figure = Figure(figsize=SIZE_IN, layout="constrained")
        grid = figure.add_gridspec(2, 2)
        whole, strike, release = (figure.add_subplot(part) for part in (grid[0, :], grid[1, 0], grid[1, 1]))
        at, time_s = find_phases(stroke), stroke.time_s
        begin = float(time_s[np.argmax(at == 1)])
        top = float(time_s[int(np.argmax(stroke.hammer.value_m))])
        rise = float(time_s[np.argmax(at == 3)]) if np.any(at == 3) else float(time_s[-1])
        end = float(time_s[-1])
        over = float(time_s[np.flatnonzero(at == 3)[-1]]) if np.any(at == 3) else rise
        _curves(whole, stroke, predicted, float(time_s[0]), end)
        _curves(strike, stroke, predicted, max(begin - 0.02, top - 10 * AROUND_STRIKE_S[0]), top + AROUND_STRIKE_S[1])
        _curves(release, stroke, predicted, rise - AROUND_RELEASE_S[0], min(max(over, rise + AROUND_RELEASE_S[1]), end))
        strike.set_title("strike", fontsize=9)
        release.set_title("release", fontsize=9)
        whole.legend(loc="upper right", ncols=5, fontsize=8, frameon=False)
        for axes in (strike, release):
            axes.set_xlabel("time, s")
        for axes in (whole, strike):
            axes.set_ylabel("share of the ruler")
        key = f"stroke-{stroke.number}"
        names = ", ".join(one.model for one in predicted)
        return figure_svg(
            figure,
            key,
            f"Trial {stroke.number} {stroke.condition}{OUTSIDE if outside else ''}",
            f"Measured displacement of key and hammer over time, and the hammer as predicted by: {names}.",
            (float(time_s[0]), float(time_s[-1])),
        )


def _curves(axes: Axes, stroke: Stroke, predicted: Sequence[Predicted], start_s: float, end_s: float) -> None:
    """Curves between two times, thinned to what a page can show."""
    inside = np.flatnonzero((stroke.time_s >= start_s) & (stroke.time_s <= end_s))
    at = inside[:: max(inside.size // MOST_POINTS, 1)]
    time_s, travel = stroke.time_s[at], stroke.hammer.travel_m
    axes.set_xlim(start_s, end_s)
    axes.plot(
        time_s, stroke.key.value_m[at] / stroke.key.travel_m, color="#8a8a8a", lw=0.8, ls=":", label="key, measured"
    )
    for one in predicted:
        colour = COLOURS[one.model]
        if one.model == "identified" and np.all(np.isfinite(one.half_m)):
            low, high = (one.hammer_m[at] + sign * one.half_m[at] for sign in (-1.0, 1.0))
            axes.fill_between(
                time_s, low / travel, high / travel, color=colour, alpha=0.18, lw=0, label="identified, 95 % band"
            )
        width = 1.3 if one.model == "identified" else 0.8
        axes.plot(time_s, one.hammer_m[at] / travel, color=colour, lw=width, label=one.model)
    axes.plot(time_s, stroke.hammer.value_m[at] / travel, color="#111111", lw=1.1, label="hammer, measured")
    axes.set_ylim(-0.25, 1.3)
    axes.grid(alpha=0.25)


HERE = Path(__file__).parent
SCHEMA = "piano-action-rig positions 1"
LEARNED = 0.5
"""A parameter is said to be learned where its standard uncertainty is below this share of its prior's."""
SCALES = {"rmse_share": 100.0, "inside_band": 100.0, "half_width_share": 100.0, "interval_score_share": 100.0}


def write_page(result: PositionComparison, folder: Path, session: Path, now: datetime | None = None) -> dict[str, Path]:
    """Write page, results and curves into a folder; return the files by name.

    Raises
    ------
    ValidationInputError
        The folder cannot be written.
    """
    check_folder(folder)
    made = (now or datetime.now(UTC)).isoformat(timespec="seconds")
    texts: dict[str, str | bytes] = {"report.html": render(result, made, session)}
    texts["results.json"] = json.dumps(_results(result, made), indent=1) + "\n"
    for number in sorted({one.stroke.number for one in result.predictions}):
        texts[f"curves/trial_{number:04d}.csv"] = _curves_csv(result, number)
    return write_files(folder, texts)


def render(result: PositionComparison, made: str, session: Path) -> str:
    """The page as HTML without outside addresses or scripts."""
    environment = templates(HERE)
    environment.filters["figure"] = lambda value, digits=1, scale=1.0: _number(value, digits, scale)
    by_number: dict[int, list[Any]] = {}
    for one in result.predictions:
        by_number.setdefault(one.stroke.number, []).append(one)
    outside = set(result.rivals["trial"][result.rivals["outside"] == True])  # noqa: E712
    strokes = [
        (parts[0].stroke, Markup(stroke_figure(parts[0].stroke, parts, number in outside)))
        for number, parts in by_number.items()
    ]
    notes = session / "limits.txt"
    return environment.get_template("positions_page.html.j2").render(
        result=result,
        made=made,
        style=style_text(),
        strokes=strokes,
        scores=result.scores.to_dict("records"),
        by_phase=result.by_phase.to_dict("records"),
        events=result.events.to_dict("records"),
        repeatability=result.repeatability.to_dict("records"),
        rivals=result.rivals.to_dict("records"),
        called={
            name: CALLED.get(short, short).removeprefix("the ")
            for name in result.rivals
            if (short := name.removesuffix(ENDING)) != name
        },
        outside=outside,
        inf=math.inf,
        parameters=parameters(result),
        release=_release(result),
        bands=result.identified.bands if result.identified else {},
        event_texts=EVENTS,
        limits=_limits([stroke for stroke, _ in strokes]),
        notes=notes.read_text(encoding="utf-8").strip().splitlines() if notes.is_file() else [],
    )


def _number(value: Any, digits: int, scale: float) -> str:
    if value is None or not isinstance(value, int | float | np.floating) or not math.isfinite(value):
        return "–"
    return f"{scale * float(value):.{digits}f}"


def parameters(result: PositionComparison) -> list[dict[str, Any]]:
    """Rows of the identified set: value, standard uncertainty, and whether the data said more than the prior."""
    record = result.identified
    if record is None:
        return []
    z, u = np.array(record.z), np.sqrt(np.diag(np.array(record.covariance)))
    by_kind = {tuple(sets.z[0]): sets for sets in record.left_out.get("identified", {}).values()}
    left_out = [list(z) for z in by_kind]
    if len(left_out) > 1:  # a fit without a stroke may end in another valley: then these data do not determine it
        u = np.maximum(u, jackknife_u(left_out))
    values = values_of(z)
    rows = []
    for one, at, spread in zip(FREE, z, u, strict=True):
        value = values[one.name]
        rows.append(
            {
                "name": one.name,
                "meaning": one.meaning,
                "value": f"{value:+.3g}" if one.adds else f"× {value:.3f}",
                "u": f"{one.width * spread:.2g}" if one.adds else f"{100 * one.width * spread:.0f} %",
                "prior": f"{one.width:.2g}" if one.adds else f"{100 * one.width:.0f} %",
                "z": f"{at:+.2f}",
                "learned": "yes" if spread < LEARNED else "hardly",
                "now": ", ".join(one.paths),
            }
        )
    return rows


def _release(result: PositionComparison) -> list[dict[str, Any]]:
    record = result.identified
    return [] if record is None else [{"group": name, **row} for name, row in record.release.items()]


def _limits(strokes: list[Stroke]) -> list[str]:
    """What these sensors forbid, from the strokes themselves."""
    out = []
    for what in ("key", "hammer"):
        ones = [getattr(stroke, what) for stroke in strokes]
        ruler, travel = ones[0].position.ruler, ones[0].travel_m
        u = np.concatenate([one.position.u_calibration_m for one in ones])
        zero = [one.zero_reading for one in ones]
        flagged = np.mean(np.concatenate([one.position.flag for one in ones]) != 0)
        out.append(
            f"{what}: sensor at {ruler.sensor_at}; the ruler of {1e3 * travel:.2f} mm stood at {ruler.calibrated_at}. "
            f"{ones[0].position.judgement.capitalize()}. Its calibration leaves {1e3 * np.median(u):.2f} mm "
            f"({100 * np.median(u) / travel:.1f} % of the ruler) open at each reading. The reading at rest drifted by "
            f"{min(zero):+.4f} to {max(zero):+.4f} between strokes and is taken off. {100 * flagged:.1f} % of the "
            "samples lie beyond the ruler: there the displacement is held at its end, and so is the prediction."
        )
    rate = 1.0 / strokes[0].interval_s
    out.append(
        f"At {rate:g} samples a second a contact with the stop of 1 to 2 ms is {rate * 1e-3:.0f} to "
        f"{2 * rate * 1e-3:.0f} samples: neither its force nor its duration is measured, nor a shank's vibration "
        "above half the rate."
    )
    out.append(
        "No force was measured: weight and inertia of the key, its friction, and touch weights are not determined by "
        "these data; the key's motion is given. What is identified of the action is the regulation and few ratios, "
        "with the geometry of another action under it: the values are those with which that model answers like this "
        "piano, not measurements of parts."
    )
    return out


def _results(result: PositionComparison, made: str) -> dict[str, Any]:
    return {
        "schema": SCHEMA,
        "made_utc": made,
        "software": {"model": model.__version__},
        "session": result.session_name,
        "action": result.action_name,
        "sentence": result.sentence,
        "advice": list(result.advice),
        "scores": records(result.scores),
        "rmse_by_phase": records(result.by_phase),
        "events": records(result.events),
        "repeatability": records(result.repeatability),
        "rivals": records(result.rivals),
        "training_distances": {k: v if math.isfinite(v) else None for k, v in result.training_distances.items()},
        "parameters": parameters(result),
        "release": _release(result),
        "bands": {name: asdict(band) for name, band in result.identified.bands.items()} if result.identified else {},
        "refused": {str(k): v for k, v in result.refused.items()},
    }


def _curves_csv(result: PositionComparison, number: int) -> str:
    """Measured and predicted curves of one stroke as CSV, SI units."""
    chosen = [one for one in result.predictions if one.stroke.number == number]
    stroke = chosen[0].stroke
    columns = {
        "time_s": stroke.time_s,
        "key_m": stroke.key.value_m,
        "hammer_m": stroke.hammer.value_m,
        "hammer_u_m": stroke.hammer.position.u_m,
        "hammer_flag": stroke.hammer.position.flag,
    }
    for one in chosen:
        columns[f"{one.model}_hammer_m"] = one.hammer_m
        columns[f"{one.model}_half_width_m"] = one.half_m
    buffer = io.StringIO()
    pd.DataFrame(columns).to_csv(buffer, index=False, float_format="%.7g")
    return buffer.getvalue()


def validate_positions(
    session: Session | str | Path,
    out: str | Path | None = None,
    *,
    action: str | None = None,
    identified: str | Path | None = None,
    progress: Callable[[str], None] | None = None,
) -> PositionComparison:
    """Compare the hammer of a session without force with models that its measured key moves, and write a page.

    Parameters
    ----------
    session : Session or path
        Trials hold position sensors of key and hammer.
    out : path, optional
        Folder for ``report.html``, ``results.json`` and ``curves/*.csv``; by default that of the session.
    action : str, optional
        Built-in action or file; by default that of the identified set, else ``hirschkorn2004-regulated``.
    identified : path, optional
        ``identified.json``, or a session folder that holds one; by default the session's own, where there is one.
    progress : callable, optional
        Called with a line of text per stroke.

    Returns
    -------
    PositionComparison
        With ``files`` naming what was written.

    Raises
    ------
    ValidationInputError
        No stroke is usable, the identified set does not fit, or the folder cannot be written.

    Examples
    --------
    >>> import validation
    >>> result = validation.validate_positions("sessions/kawai_kg3c", "real")
    >>> bool(result.scores.query("model == 'identified'").rmse_share.max() < 0.1)
    True
    """
    opened = session if isinstance(session, Session) else Session.open(session)
    folder = Path(out) if out is not None else opened.path
    check_folder(folder)
    say = progress or (lambda text: None)
    result = compare_positions(opened, action, None if identified is None else Path(identified), say)
    say("writing the report")
    return replace(result, files=write_page(result, folder, opened.path))
