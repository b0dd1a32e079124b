"""Several sessions and several models: every session with every model.

A session recorded under several conditions is one session for each of them. A session that cannot be compared is named
in one line in ``refused`` and the rest goes on.
"""

from __future__ import annotations

import copy
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Unpack

import model
from model.errors import ModelError
from rig.errors import RigError
from rig.session import Session
from validation.cache.report_cache import report_folder
from validation.errors import ValidationError, ValidationInputError
from validation.measurement.measure_session import conditions_of, open_session
from validation.options import CompareOptions, ComparisonOptions
from validation.pipeline.compare_session import compare_by, load_model
from validation.prediction.model_under_test import action_sha256
from validation.report.files import check_folder
from validation.report.write import write_side_by_side
from validation.result import ValidationResult
from validation.side_by_side import SideBySide


def by_condition(opened: Sequence[Session], condition: str | None) -> list[tuple[Session, str | None]]:
    """Each session with the condition to compare, one of several conditions once for each; under distinct names."""
    parts: list[tuple[Session, str | None]] = []
    names = []
    for session in opened:
        found = conditions_of(session)
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


def distinct_models(actions: Sequence[model.Action]) -> list[model.Action]:
    """Models with distinct names; two with the same values are the same model and refused."""
    seen: dict[str, str] = {}
    for action in actions if len(actions) > 1 else ():
        digest = action_sha256(action)
        if digest in seen:
            raise ValidationInputError(
                f"{action.origin}: model {action.name!r} has the same values as {seen[digest]}; name each model once"
            )
        seen[digest] = action.origin
    files = [Path(action.origin) for action in actions]
    names = [action.name for action in actions]
    changes = [", ".join(f"{path}={v:g}" for path, v in a.changed.items()) for a in actions]
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


def _count(n: int) -> str:
    return f"{n} recorded trial{'' if n == 1 else 's'}"


def same_recordings(results: Sequence[ValidationResult]) -> list[str]:
    """Sessions that hold the same recordings under other names, in words: they are not independent."""
    seals: dict[str, set[str]] = {}
    for result in results:
        seals.setdefault(result.session_name, set()).update(result.provenance.get("trials_sha256", {}).values())
    names = list(seals)
    return [
        f"{a} and {b} share {_count(len(seals[a] & seals[b]))} (same SHA-256): they are not independent."
        for i, a in enumerate(names)
        for b in names[i + 1 :]
        if seals[a] & seals[b]
    ]


USER_ERRORS = (RigError, ValidationError, ModelError)
"""What a session that cannot be read or predicted raises; a defect is not among them."""


def compare_many(
    sessions: Sequence[Session | str | Path],
    actions: Sequence[model.Action | str | Path] = ("hirschkorn2004",),
    **options: Unpack[CompareOptions],
) -> SideBySide:
    """Compare every session with every model.

    Parameters
    ----------
    sessions : sequence of Session or path
        A session of several conditions counts as one session for each, unless ``condition`` chooses.
    actions : sequence of name, path or model.Action
    **options
        Those of `validation.compare`; ``condition`` holds for all sessions.

    Returns
    -------
    SideBySide
        One result for each session and model, and how the models compare.

    Raises
    ------
    ValidationInputError
        A session or a model is given twice, a model cannot be read, or no session can be compared.
    TypeError
        A keyword that is not known.

    Examples
    --------
    >>> import validation
    >>> models = ["hirschkorn2004", "hirschkorn2004-regulated"]
    >>> side = validation.compare_many(["sessions/example_forte"], models, budget=False, explain=False)
    >>> [result.action_name for result in side.results]
    ['hirschkorn2004', 'hirschkorn2004-regulated']
    """
    chosen = ComparisonOptions.of(options)
    models = distinct_models([load_model(action) for action in actions])
    opened, refused = open_all(sessions)
    results: list[ValidationResult] = []
    failures: list[Exception] = [error for _, error in refused]
    lines = [text for text, _ in refused]
    for session, condition in by_condition(opened, chosen.condition):
        label = session.info.name
        for action in models:
            if len(opened) > 1 or len(models) > 1:
                chosen.say(f"session {label}, model {action.name}")
            try:
                results.append(
                    compare_by(session, action, replace(chosen, condition=condition, paired=len(models) > 1))
                )
            except USER_ERRORS as error:
                failures.append(error)
                lines.append(f"session {label} with model {action.name}: {error}")
    if not results:
        if len(failures) == 1:
            raise failures[0]
        raise ValidationInputError(f"no session can be compared: {'; '.join(lines)}")
    return SideBySide(tuple(results), tuple(lines), tuple(same_recordings(results)))


def open_all(sessions: Sequence[Session | str | Path]) -> tuple[list[Session], list[tuple[str, Exception]]]:
    places = Counter(Path(s.path if isinstance(s, Session) else s).resolve() for s in sessions)
    for place, n in places.items():
        if n > 1:
            raise ValidationInputError(f"{place}: session given {n} times; name each session once")
    opened: list[Session] = []
    refused: list[tuple[str, Exception]] = []
    for one in sessions:
        try:
            opened.append(open_session(one))
        except USER_ERRORS as error:
            refused.append((str(error), error))
    return opened, refused


def validate_sessions(
    sessions: Sequence[Session | str | Path],
    actions: Sequence[model.Action | str | Path] = ("hirschkorn2004",),
    out: str | Path | None = None,
    **options: Unpack[CompareOptions],
) -> SideBySide:
    """Compare every session with every model and write one report.

    Parameters
    ----------
    sessions : sequence of Session or path
    actions : sequence of name, path or model.Action
    out : path, optional
        Folder for ``report.html``, ``results.json`` and ``tables/*.csv``; by default that of the session, if it is one.
    **options
        Those of `validation.compare`.

    Returns
    -------
    SideBySide
        With ``files`` naming what was written.

    Raises
    ------
    ValidationInputError
        No session can be compared, a session or model is given twice, or the folder cannot be written.
    TypeError
        A keyword that is not known.

    Examples
    --------
    >>> import validation
    >>> side = validation.validate_sessions(["sessions/example_forte"], out="report", budget=False, explain=False)
    >>> side.files["report.html"].name
    'report.html'
    """
    chosen = ComparisonOptions.of(options)
    folder = report_folder([s.path if isinstance(s, Session) else s for s in sessions], out)
    check_folder(folder)  # before any work is done
    side = compare_many(sessions, actions, **CompareOptions({"further": True, **options}))
    chosen.say("writing the report")
    return write_side_by_side(side, folder)


def validate_session(
    session: Session | str | Path,
    action: model.Action | str | Path = "hirschkorn2004",
    out: str | Path | None = None,
    **options: Unpack[CompareOptions],
) -> ValidationResult:
    """Compare one session with one model and write the report: `validate_sessions` for one of each.

    Parameters
    ----------
    session : Session or path
    action : name, path or model.Action
    out : path, optional
        Folder for the report; by default that of the session.
    **options
        Those of `validation.compare`.

    Returns
    -------
    ValidationResult
        With ``files`` naming what was written.

    Raises
    ------
    ValidationInputError
        The session cannot be compared, or the folder cannot be written.
    TypeError
        A keyword that is not known.

    Examples
    --------
    >>> import validation
    >>> result = validation.validate_session("sessions/example_forte", out="one", budget=False, explain=False)
    >>> "report.html" in result.files
    True
    """
    return validate_sessions([session], [action], out, **options).results[0]
