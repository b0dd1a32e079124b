"""Several sessions and several models: every session with every model.

A session recorded under several conditions is one session for each of them. A session that cannot be compared is named
in one line in ``refused`` and the rest goes on.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Unpack

import model
from model.errors import ModelError
from rig.errors import RigError
from rig.session import Session
from validation.errors import ValidationError, ValidationInputError
from validation.measurement.session import open_session
from validation.options import CompareOptions, ComparisonOptions
from validation.pipeline.compare_session import compare_by, load_model
from validation.pipeline.distinct_names import by_condition, distinct_models, same_recordings
from validation.result import ValidationResult
from validation.side_by_side import SideBySide
from validation.statistics.model_comparison import paired_models

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
    >>> side = validation.compare_many(["sessions/example_forte"], models, budget=False, suspect=False)
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
    return SideBySide(tuple(results), tuple(lines), paired_models(results), tuple(same_recordings(results)))


compare_sessions = compare_many


def open_all(sessions: Sequence[Session | str | Path]) -> tuple[list[Session], list[tuple[str, Exception]]]:
    """Sessions that can be opened, and of each other one a line with its error."""
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
