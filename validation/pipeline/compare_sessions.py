"""Several sessions and several models side by side: every session with every model, nothing pooled.

Place in the data flow: sessions and actions → `validation.pipeline.compare_session`, one `ValidationResult` for each
pair → here, with the paired comparison of the models → `validation.report`.
Conventions: results in the order of sessions, then of models; a session recorded under several conditions is one
session for each of them.  Names are made distinct: sessions by their folder, models by their file.
Failure: a session that cannot be compared is named in one line in ``refused`` and the rest goes on; when nothing is
left, or a session or model is given twice, `InputError`.
"""

from __future__ import annotations

import copy
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import pandas as pd

from validation.errors import InputError, ValidationError
from validation.measurement.session import open_session
from validation.pipeline.compare_session import compare_session, load_model
from validation.prediction.trial_prediction import action_sha256
from validation.result import ValidationResult
from validation.statistics.model_comparison import paired_models


@dataclass(frozen=True, repr=False)
class SideBySide:
    """Results of several sessions and models, in the order of sessions, then of models.

    Attributes
    ----------
    results : tuple of ValidationResult
        Each with its own names of session and model.
    refused : tuple of str
        One line for each session, or session with model, that could not be compared.
    model_pairs : DataFrame
        One row per session, channel, score and pair of models: see `validation.statistics.model_comparison`.
    notes : tuple of str
        What a reader must know about the sessions together.
    files : dict
        What was written: name → path.
    """

    results: tuple[ValidationResult, ...]
    refused: tuple[str, ...]
    model_pairs: pd.DataFrame
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
        return [*lines, *pair_lines(self.model_pairs), *(f"Not compared: {text}" for text in self.refused), *self.notes]

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
        tables = {name: _below(parts) for name, parts in joined.items()}
        return {**tables, "model_pairs": self.model_pairs}

    def with_files(self, files: dict[str, Path]) -> SideBySide:
        """A copy that names the files it was written to."""
        return replace(self, files=files, results=tuple(r.with_files(files) for r in self.results))


def _below(parts: list[pd.DataFrame]) -> pd.DataFrame:
    """Tables below each other; those without rows only lend their columns."""
    filled = [part for part in parts if len(part)]
    return pd.concat(filled, ignore_index=True) if filled else parts[0]


def headline(result: ValidationResult) -> str:
    """The first line of a verdict, and the kinds of fault that were found in the session."""
    kinds = ", ".join(dict.fromkeys(result.findings["kind"]))
    return result.verdict_lines[0] + (f" Faults found: {kinds}; see its warnings." if kinds else "")


def alone(result: ValidationResult) -> SideBySide:
    """One result as the only one of its kind."""
    return SideBySide((result,), (), paired_models([result]), files=result.files)


def compare_sessions(
    sessions: Sequence[Any],
    actions: Sequence[Any] = ("hirschkorn2004",),
    *,
    condition: str | None = None,
    progress: Callable[[str], None] | None = None,
    **options: Any,
) -> SideBySide:
    """Compare every session with every model.

    Parameters
    ----------
    sessions : sequence of path or rig.session.Session
        A session of several conditions counts as one session for each, unless `condition` chooses.
    actions : sequence of name, path or model action
    condition : str, optional
        Condition of the trial plan to keep to, in all sessions.
    progress : callable, optional
        Called with a line of text per step.
    **options
        Passed to `validation.pipeline.compare_session.compare_session`.

    Raises
    ------
    InputError
        A session or a model is given twice, a model cannot be read, or no session can be compared.
    """
    models = distinct_models([load_model(action) for action in actions])
    opened, refused = open_all(sessions)
    results: list[ValidationResult] = []
    failures: list[Exception] = [error for _, error in refused]
    lines = [text for text, _ in refused]
    for session, chosen in by_condition(opened, condition):
        label = session.info.name
        for model in models:
            if progress is not None and (len(opened) > 1 or len(models) > 1):
                progress(f"session {label}, model {model.name}")
            try:
                results.append(compare_session(session, model, condition=chosen, progress=progress, **options))
            except _user_errors() as error:
                failures.append(error)
                lines.append(f"session {label} with model {model.name}: {error}")
    if not results:
        if len(failures) == 1:
            raise failures[0]
        raise InputError(f"no session can be compared: {'; '.join(lines)}")
    return SideBySide(tuple(results), tuple(lines), paired_models(results), tuple(same_recordings(results)))


def open_all(sessions: Sequence[Any]) -> tuple[list[Any], list[tuple[str, Exception]]]:
    """Sessions that can be opened, and of each other one a line with its error."""
    places = Counter(Path(getattr(s, "path", s)).resolve() for s in sessions)
    for place, n in places.items():
        if n > 1:
            raise InputError(f"{place}: session given {n} times; name each session once")
    opened: list[Any] = []
    refused: list[tuple[str, Exception]] = []
    for one in sessions:
        try:
            opened.append(open_session(one))
        except _user_errors() as error:
            refused.append((str(error), error))
    return opened, refused


def by_condition(opened: Sequence[Any], condition: str | None) -> list[tuple[Any, str | None]]:
    """Each session with the condition to keep to, one of several conditions once for each; under distinct names."""
    parts: list[tuple[Any, str | None]] = []
    names = []
    for session in opened:
        found = [c.name for c in session.info.plan.conditions]
        own = session.info.name or session.path.name
        if len(found) < 2:
            parts.append((copy.copy(session), condition))
            names.append(own)
        else:
            chosen = found if condition is None else [condition]
            parts += [(copy.copy(session), name) for name in chosen]
            names += [f"{own}, {name}" for name in chosen]
    folders = [s.path for s, _ in parts]
    for (session, _), name in zip(parts, distinct(names, [f.name for f in folders], folders), strict=True):
        session.info = session.info.model_copy(update={"name": name})
    return parts


def distinct_models(actions: Sequence[Any]) -> list[Any]:
    """Models with distinct names; two with the same values are the same model and refused."""
    seen: dict[str, str] = {}
    for action in actions if len(actions) > 1 else ():
        digest = action_sha256(action)
        if digest in seen:
            raise InputError(
                f"{action.origin}: model {action.name!r} has the same values as {seen[digest]}; name each model once"
            )
        seen[digest] = str(action.origin)
    files = [Path(str(getattr(action, "origin", ""))) for action in actions]
    names = [str(getattr(action, "name", "unknown")) for action in actions]
    changes = [", ".join(f"{path}={v:g}" for path, v in getattr(a, "changed", {}).items()) for a in actions]
    numbers = [f"model {i}" for i in range(1, len(actions) + 1)]
    called = distinct(names, [f.name for f in files], files, [text or "unchanged" for text in changes], numbers)
    return [
        action if name == new else replace(action, name=new)
        for action, name, new in zip(actions, names, called, strict=True)
    ]


def distinct(names: Sequence[str], *details: Sequence[object]) -> list[str]:
    """Names, followed where they are not alone by the first detail that tells them apart."""
    out = list(names)
    for detail in details:
        count = Counter(out)
        out = [
            f"{name} ({more})" if count[now] > 1 else now for name, now, more in zip(names, out, detail, strict=True)
        ]
    return out


def same_recordings(results: Sequence[ValidationResult]) -> list[str]:
    """Sessions that hold the same recordings under other names, in words: they are not independent."""
    seals: dict[str, set[str]] = {}
    for result in results:
        seals.setdefault(result.session_name, set()).update(result.provenance.get("trials_sha256", {}).values())
    names = list(seals)
    return [
        f"{a} and {b} share {len(seals[a] & seals[b])} recorded trials (same SHA-256): they are not independent."
        for i, a in enumerate(names)
        for b in names[i + 1 :]
        if seals[a] & seals[b]
    ]


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


def _user_errors() -> tuple[type[Exception], ...]:
    """What a session that cannot be read or predicted raises; a defect is not among them."""
    from model.errors import ModelError
    from rig.errors import RigError

    return (RigError, ValidationError, ModelError)
