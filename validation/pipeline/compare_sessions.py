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

from threadpoolctl import threadpool_limits

import model
from model.errors import ModelError
from rig.errors import RigError
from rig.session import Session
from validation.errors import ValidationError, ValidationInputError
from validation.measurement.measure_session import conditions_of, open_session
from validation.options import ComparisonOptions
from validation.pipeline.compare_session import compare_by, load_model
from validation.prediction.model_under_test import action_sha256
from validation.result import ValidationResult
from validation.side_by_side import SideBySide


def pair_with_conditions(opened: Sequence[Session], condition: str | None) -> list[tuple[Session, str | None]]:
    """Copies of the sessions under distinct names, each with the condition to compare: of a session of several
    conditions one copy for each, or only ``condition``; else ``condition`` as it is."""
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
    for (session, _), name in zip(parts, make_distinct(names, [f.name for f in folders], folders), strict=True):
        session.info = session.info.model_copy(update={"name": name})
    return parts


def distinct_models(actions: Sequence[model.Action]) -> list[model.Action]:
    """The models, renamed where names are equal so that all differ; raises an input error where two have the same
    values."""
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
    called = make_distinct(names, [f.name for f in files], files, [text or "unchanged" for text in changes], numbers)
    return [
        action if name == new else replace(action, name=new)
        for action, name, new in zip(actions, names, called, strict=True)
    ]


def make_distinct(names: Sequence[str], *details: Sequence[object]) -> list[str]:
    """Names, each that occurs more than once with the first detail in brackets that is not the same for all of them;
    names whose details are all the same stay equal."""
    out = list(names)
    for detail in details:
        found: dict[str, set[object]] = {}
        for name, more in zip(out, detail, strict=True):
            found.setdefault(name, set()).add(more)
        out = [
            f"{name} ({more})" if len(found[now]) > 1 else now
            for name, now, more in zip(names, out, detail, strict=True)
        ]
    return out


def _count(n: int) -> str:
    return f"{n} recorded trial{'' if n == 1 else 's'}"


def same_recordings(results: Sequence[ValidationResult]) -> list[str]:
    """Sentences on sessions that hold equal recordings under different names, and so are not independent."""
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


@threadpool_limits.wrap(limits=1, user_api="blas")
def compare_every(
    sessions: Sequence[Session | str | Path], actions: Sequence[model.Action | str | Path], chosen: ComparisonOptions
) -> SideBySide:
    """Results of every session with every model; errors of a user are collected in ``refused`` and the rest goes on.
    Raises an input error where a model cannot be read or no session can be compared."""
    models = distinct_models([load_model(action) for action in actions])
    opened, refused = open_all(sessions)
    results: list[ValidationResult] = []
    failures: list[Exception] = [error for _, error in refused]
    lines = [text for text, _ in refused]
    for session, condition in pair_with_conditions(opened, chosen.condition):
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
    """Sessions that can be opened, and for each other one its message and error; raises an input error where a session
    is given twice."""
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
