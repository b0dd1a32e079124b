"""``pianorig study``: variants of an action under one blow, and the thesis's own studies, as tables and figures."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import model
from model.study import Study, ThesisStudy, Variant, compare, draw_study, draw_thesis, thesis_studies
from pianorig.console.column_file import write_rows
from pianorig.console.output import nan_as_null, print_files
from pianorig.console.overrides import read_variant
from pianorig.console.progress import working
from pianorig.workflows.model.force_input import read_driving_force


def study_variants(
    action: model.Action, force: Path, texts: Sequence[str], out: Path | None, quiet: bool
) -> dict[str, Any]:
    """Simulate, print and write variants of an action, each written as ``--variant`` takes it.

    ``force`` is a CSV table or a sealed trial; under a trial the arm's preload acts from the first sample on.
    """
    wanted = [Variant(*read_variant(text)) for text in texts]
    driving = read_driving_force(force)
    with working(f"simulating {len(wanted) + 1} blows", quiet):
        study = compare(action, driving.time_s, driving.force_n, wanted)
    files: list[Path] = []
    if out is not None:
        files = [out / "study.svg", out / "variants.csv"]
        draw_study(study, files[0])
        write_rows(files[1], study.rows())
    if not quiet:
        _print_study(study)
        print_files(files)
    return {"action": study.action, "force_table": force, "variants": _plain(study.rows()), "files": files}


def study_thesis(action: model.Action, force: Path | None, out: Path | None, quiet: bool) -> dict[str, Any]:
    """Simulate, print and write the thesis's studies; another forte may be given."""
    driving = None if force is None else read_driving_force(force)
    forte = None if driving is None else (driving.time_s, driving.force_n)
    with working("repeating the studies of the thesis, Sections 4.2.2 and 4.4", quiet):
        studies = thesis_studies(action, forte)
    observations = [asdict(o) for o in studies.observations]
    files: list[Path] = []
    if out is not None:
        files = [out / "thesis.svg", out / "observations.csv", out / "piano.csv", out / "forte.csv"]
        draw_thesis(studies, files[0])
        for path, rows in zip(files[1:], (observations, studies.piano.rows(), studies.forte.rows()), strict=True):
            write_rows(path, rows)
    if not quiet:
        for blow, study in (("piano", studies.piano), ("forte", studies.forte)):
            print(f"{action.name}, {blow}")
            _print_study(study)
            print()
        _print_observations(studies)
        print_files(files)
    return {
        "action": action.name,
        "observations": _plain(observations),
        "piano": _plain(studies.piano.rows()),
        "forte": _plain(studies.forte.rows()),
        "files": files,
    }


def _plain(rows: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    return [nan_as_null(row) for row in rows]


def _print_study(study: Study) -> None:
    """One line per variant."""
    width = max(12, *(len(v.name) for v in study.variants))
    print(
        f"{'variant':<{width}}  {'strike s':>9} {'m/s':>6} {'strikes':>7} {'held':>5} {'hold mm':>8} {'moved mm':>9}"
        f" {'lever':>6} {'RMS deg':>8}"
    )
    for row in study.rows():
        cells: dict[str, Any] = {k: math.nan if v is None else v for k, v in row.items()}
        line = (
            f"{cells['variant']:<{width}}  {cells['strike_s']:>9.4f} {cells['strike_m_per_s']:>6.3f} "
            f"{cells['strikes']:>7} {'yes' if cells['held'] else 'no':>5} {1e3 * cells['hold_m']:>8.2f} "
            f"{1e3 * cells['hold_moved_m']:>9.3f} {cells['lever_bounces']:>6} "
            f"{math.degrees(cells['hammer_rms_rad']):>8.3f}"
        )
        print(line.replace("nan", "  -"))
    print(
        "hold: hammer to string; moved: in the last 0.1 s of the hold; lever: contacts of knuckle and lever meanwhile;"
    )
    print("RMS: difference of the hammer's angle from the action as given")


def _print_observations(studies: ThesisStudy) -> None:
    """The thesis's observations, line by line."""
    confirmed = sum(o.holds for o in studies.observations)
    print(f"observations of the thesis: {confirmed} of {len(studies.observations)} hold here")
    for o in studies.observations:
        place = f"{'Sec.' if o.figure == '4.4' else 'Fig.'} {o.figure}"
        print(f"{'holds' if o.holds else 'NOT':<6} {place:<10} {o.statement}")
        print(f"{'':<17} {o.judged_by}: {o.found:.3g}{f' {o.unit}' if o.unit else ''} (allowed {o.allowed})")
