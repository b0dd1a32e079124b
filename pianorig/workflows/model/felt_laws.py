"""``pianorig calibrate-felt`` with several presses: which law of felt they support, and the values of each."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import model
from model.felt import LawComparison, LawFit, compare_laws, read_pressing
from model.felt.figure import draw
from pianorig.console.output import nan_as_null
from pianorig.errors import CommandInputError
from pianorig.workflows.model.calibrate import Calibrated

THESIS_LAW = "hunt-crossley"


def felt_laws(action: model.Action, paths: Sequence[Path], contact: str | None, figure: Path | None) -> Calibrated:
    """Every law fitted to all presses and judged by presses left out; values are those of the thesis's law."""
    if contact is not None and f"{contact}.normal.a" not in action.quantities:
        raise CommandInputError(f"--contact {contact}: not found; allowed contact01 to contact13")
    presses = [read_pressing(path) for path in paths]
    found = compare_laws(presses)
    lines = [f"{contact or 'felt'}: {len(presses)} presses, {_span(presses)}", *_table(found), f"  {found.verdict}"]
    for fit in found.fits:
        lines.append(f"  {fit.kind}: " + ", ".join(_value(fit, k) for k in range(len(fit.names))))
    if figure is not None:
        draw(presses, found, contact or "felt", figure)
        lines.append(f"  {figure}")
    values: dict[str, tuple[float, float]] = {}
    if contact is not None:
        thesis = next(fit for fit in found.fits if fit.kind == THESIS_LAW)
        values = {
            f"{contact}.normal.{name}": (value, u)
            for name, value, u in zip(thesis.names, thesis.values, thesis.u, strict=True)
        }
        if THESIS_LAW not in found.supported:
            lines.append(
                f"  {contact} gets the values of {THESIS_LAW}, the law of the model, which these presses reject"
            )
    return Calibrated(_facts(found, contact, figure), lines, values)


def _span(presses: Sequence[model.felt.Pressing]) -> str:
    speeds, peaks = [1e3 * p.speed_m_per_s for p in presses], [p.peak_n for p in presses]
    return f"{min(speeds):.3g} to {max(speeds):.3g} mm/s, peaks of {min(peaks):.3g} to {max(peaks):.3g} N"


def _table(found: LawComparison) -> list[str]:
    """Misfit of each law on presses left out and on those it was fitted to."""
    lines = [f"  {'law':<14} {'left out':>9} {'fitted':>9} {'p':>7}   misfit, share of the peak force, typical press"]
    for k, fit in enumerate(found.fits):
        own = float(fit.misfit.mean())
        lines.append(f"  {fit.kind:<14} {found.overall[k]:>9.2%} {own:>9.2%} {found.p_value[k]:>7.2g}")
    lines.append(f"  {'noise':<14} {found.noise.mean():>9.2%}")
    return lines


def _value(fit: LawFit, k: int) -> str:
    unit = "" if fit.units[k] == "1" else f" {fit.units[k]}"
    return f"{fit.names[k]} = {fit.values[k]:.4g} u {fit.u[k]:.2g}{unit}"


def _facts(found: LawComparison, contact: str | None, figure: Path | None) -> dict[str, Any]:
    laws = {
        fit.kind: {
            "values": nan_as_null(dict(zip(fit.names, fit.values, strict=True))),
            "u": nan_as_null(dict(zip(fit.names, fit.u, strict=True))),
            "units": dict(zip(fit.names, fit.units, strict=True)),
            "misfit_left_out": dict(zip(found.presses, found.held_out[k].tolist(), strict=True)),
            "misfit_fitted": dict(zip(found.presses, fit.misfit.tolist(), strict=True)),
            "p_value": float(found.p_value[k]),
        }
        for k, fit in enumerate(found.fits)
    }
    return {
        "contact": contact,
        "laws": laws,
        "noise": dict(zip(found.presses, found.noise.tolist(), strict=True)),
        "supported": found.supported,
        "verdict": found.verdict,
        "figure": figure,
    }
