"""Sessions and models under distinct names: sessions told apart by their folder, models by file and changes."""

from __future__ import annotations

import copy
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import model
from rig.session import Session
from validation.errors import ValidationInputError
from validation.prediction.model_under_test import action_sha256
from validation.result import ValidationResult


def by_condition(opened: Sequence[Session], condition: str | None) -> list[tuple[Session, str | None]]:
    """Each session with the condition to compare, one of several conditions once for each; under distinct names."""
    parts: list[tuple[Session, str | None]] = []
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
