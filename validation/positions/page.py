"""The page and the files of a comparison of positions: ``report.html``, ``results.json``, ``curves/trial_NNNN.csv``."""

from __future__ import annotations

import io
import json
import math
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

import model
from validation.conventions import Array
from validation.positions.compare import PositionComparison
from validation.positions.events import EVENTS
from validation.positions.figures import stroke_figure
from validation.positions.measured import Stroke
from validation.positions.parameters import FREE, values_of
from validation.report import files

HERE = Path(__file__).parent
CSS = HERE.parent / "report" / "report.css"
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
    files.check_folder(folder)
    made = (now or datetime.now(UTC)).isoformat(timespec="seconds")
    texts: dict[str, str | bytes] = {"report.html": render(result, made, session)}
    texts["results.json"] = json.dumps(_results(result, made), indent=1) + "\n"
    for number in sorted({one.stroke.number for one in result.predictions}):
        texts[f"curves/trial_{number:04d}.csv"] = _curves(result, number)
    return files.write_files(folder, texts)


def render(result: PositionComparison, made: str, session: Path) -> str:
    """The page as HTML without outside addresses or scripts."""
    environment = Environment(
        loader=FileSystemLoader(HERE), autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters["figure"] = lambda value, digits=1, scale=1.0: _number(value, digits, scale)
    by_number: dict[int, list[Any]] = {}
    for one in result.predictions:
        by_number.setdefault(one.stroke.number, []).append(one)
    strokes = [(parts[0].stroke, Markup(stroke_figure(parts[0].stroke, parts))) for parts in by_number.values()]
    notes = session / "limits.txt"
    return environment.get_template("page.html.j2").render(
        result=result,
        made=made,
        style=Markup(CSS.read_text(encoding="utf-8")),
        strokes=strokes,
        scores=_rows(result.scores),
        by_phase=_rows(result.by_phase),
        events=_rows(result.events),
        repeatability=_rows(result.repeatability),
        parameters=parameters(result),
        release=_release(result),
        bands=result.identified.bands if result.identified else {},
        event_texts=EVENTS,
        limits=_limits([stroke for stroke, _ in strokes]),
        notes=notes.read_text(encoding="utf-8").strip().splitlines() if notes.is_file() else [],
    )


def _rows(table: pd.DataFrame) -> list[dict[str, Any]]:
    return [{str(k): v for k, v in row.items()} for row in table.to_dict("records")]


def _number(value: Any, digits: int, scale: float) -> str:
    if value is None or not isinstance(value, int | float | np.floating) or not math.isfinite(value):
        return "–"
    return f"{scale * float(value):.{digits}f}"


def parameters(result: PositionComparison) -> list[dict[str, Any]]:
    """Rows of the identified set: value, standard uncertainty, and whether the data said more than the prior."""
    record = result.identified
    if record is None:
        return []
    z = np.array(record.z)
    u = np.maximum(np.sqrt(np.diag(np.array(record.covariance))), _jackknife(record.left_out.get("identified", {})))
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


def _jackknife(left_out: dict[str, list[float]]) -> float | Array:
    """Standard uncertainty of each parameter (p,) by leaving out one stroke at a time; 0 where none was left out.

    A fit without a stroke may end in another valley: then these data do not determine the parameter.
    """
    if len(left_out) < 2:
        return 0.0
    table = np.array(list(left_out.values()))
    n = len(table)
    return np.asarray(np.sqrt((n - 1) / n * np.sum((table - table.mean(axis=0)) ** 2, axis=0)))


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
    def plain(table: pd.DataFrame) -> list[dict[str, Any]]:
        return [
            {key: None if isinstance(v, float) and not math.isfinite(v) else v for key, v in row.items()}
            for row in _rows(table.astype(object).where(table.notna(), None))
        ]

    return {
        "schema": SCHEMA,
        "made_utc": made,
        "software": {"model": model.__version__},
        "session": result.session_name,
        "action": result.action_name,
        "sentence": result.sentence,
        "scores": plain(result.scores),
        "rmse_by_phase": plain(result.by_phase),
        "events": plain(result.events),
        "repeatability": plain(result.repeatability),
        "parameters": parameters(result),
        "release": _release(result),
        "bands": {name: asdict(band) for name, band in result.identified.bands.items()} if result.identified else {},
        "refused": {str(k): v for k, v in result.refused.items()},
    }


def _curves(result: PositionComparison, number: int) -> str:
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
