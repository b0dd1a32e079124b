"""`SideBySide`: results of several sessions and models, nothing pooled, with the paired comparison of the models.

Conventions: results in the order of sessions, then of models.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import pandas as pd

from validation.numbers import with_u
from validation.result import ValidationResult
from validation.tables.catalogue import all_tables


@dataclass(frozen=True, repr=False)
class SideBySide:
    """Results of several sessions and models, in the order of sessions, then of models.

    Attributes
    ----------
    results : tuple of ValidationResult
        Each with its own names of session and model.
    refused : tuple of str
        One line for each session, or session with model, that could not be compared.
    notes : tuple of str
        What a reader must know about the sessions together.
    files : dict
        What was written: name → path.
    """

    results: tuple[ValidationResult, ...]
    refused: tuple[str, ...]
    notes: tuple[str, ...] = ()
    files: dict[str, Path] = field(default_factory=dict)

    def __repr__(self) -> str:
        return f"SideBySide({len(self.sessions)} sessions, {len(self.models)} models)"

    @property
    def sessions(self) -> dict[str, list[ValidationResult]]:
        """Results by session: one for each model that could be compared with it."""
        found: dict[str, list[ValidationResult]] = {}
        for result in self.results:
            found.setdefault(result.session_name, []).append(result)
        return found

    @property
    def models(self) -> list[str]:
        """Names of the models, in their order."""
        return list(dict.fromkeys(result.action_name for result in self.results))

    @property
    def verdict_lines(self) -> list[str]:
        """One line per session and model; all lines of the verdict when there is one result only."""
        lines = self.results[0].verdict_lines if len(self.results) == 1 else [headline(r) for r in self.results]
        return [*lines, *self.compared_lines, *(f"Not compared: {text}" for text in self.refused), *self.notes]

    @property
    def compared_lines(self) -> list[str]:
        """How the models compare, a line each."""
        return [*pair_lines(self.model_pairs), *evidence_lines(self.evidence)]

    @cached_property
    def compared(self) -> dict[str, pd.DataFrame]:
        """Tables of all results together by name: how the models compare."""
        return {name: table.make(self.results) for name, table in all_tables().items() if table.of == "results"}

    @property
    def model_pairs(self) -> pd.DataFrame:
        """One row per session, channel, score and pair of models: see `validation.statistics.model_comparison`."""
        return self.compared["model_pairs"]

    @property
    def evidence(self) -> pd.DataFrame:
        """One row per session and model, where there are several models."""
        return self.compared["evidence"]

    @property
    def tables(self) -> dict[str, pd.DataFrame]:
        """Every table of every result below each other, led by the columns ``session`` and ``model``."""
        joined: dict[str, list[pd.DataFrame]] = {}
        for result in self.results:
            for name, table in result.tables.items():
                named = table.copy()
                named.insert(0, "session", result.session_name)
                named.insert(1, "model", result.action_name)
                joined.setdefault(name, []).append(named)
        return {name: _stack_tables(parts) for name, parts in joined.items()} | self.compared

    def with_files(self, files: dict[str, Path]) -> SideBySide:
        """A copy that names the files it was written to."""
        return replace(self, files=files, results=tuple(r.with_files(files) for r in self.results))


def _stack_tables(parts: list[pd.DataFrame]) -> pd.DataFrame:
    """Tables below each other; those without rows only lend their columns."""
    filled = [part for part in parts if len(part)]
    return pd.concat(filled, ignore_index=True) if filled else parts[0]


def headline(result: ValidationResult) -> str:
    """The first line of a verdict, and the kinds of fault that were found in the session."""
    kinds = ", ".join(dict.fromkeys(result.findings["kind"]))
    return result.verdict_lines[0] + (f" Findings: {kinds}; see its warnings." if kinds else "")


def present_alone(result: ValidationResult) -> SideBySide:
    return SideBySide((result,), (), files=result.files)


def pair_lines(pairs: pd.DataFrame) -> list[str]:
    """The paired comparison of the models by RMSE, one sentence per session and pair."""
    lines = []
    rmse = pairs[pairs["score"] == "rmse_rad"]
    for (session, first, second), rows in rmse.groupby(["session", "first", "second"], sort=False):
        claims: dict[str, list[str]] = {}
        for row in rows.itertuples():
            claims.setdefault(row.claim, []).append(row.channel)
        said = "; ".join(f"{', '.join(channels)}: {claim}" for claim, channels in claims.items())
        lines.append(f"Session {session}, RMSE of {second} against {first}, paired by trial: {said}.")
    return lines


def evidence_lines(evidence: pd.DataFrame) -> list[str]:
    """The evidence for each further model against the first, where it was judged, and what it costs."""
    lines = []
    for row in evidence[evidence["model"] != evidence["against"]].itertuples():
        if math.isfinite(row.log_bayes_factor):
            size = f"ln of the Bayes factor {with_u(row.log_bayes_factor, row.u_log_bayes_factor)}"
            cost = f"{row.cost_ratio:.2f} × its right-hand sides, {1e3 * row.seconds:.0f} ms of processor time"
            said = f"evidence for {row.model} against {row.against}: {row.reading} ({size})"
            lines.append(f"Session {row.session}, {said}; a blow costs {cost}.")
    return lines
