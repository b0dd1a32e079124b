"""Resuming an interrupted session on the bench it was begun on."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing
from pathlib import Path

from pianorig.workflows.bench.access import BenchAccess
from pianorig.workflows.model.predict_blow import predictor
from rig import Progress, Session, open_backend, resume_session, session_rig


def resume(
    folder: Path,
    access: BenchAccess,
    progress: Callable[[Progress], None] | None = None,
    before_trial: Callable[[int], None] | None = None,
) -> tuple[Session, list[int]]:
    """Record what is left of a session's plan; return the session and the numbers of the new trials.

    The rig file is the session's own; that of ``access`` does not count. ``progress`` and ``before_trial`` as for
    `rig.record`.

    Raises
    ------
    rig.errors.RigError : nothing left, another kind of bench, or the bench stopped
    """
    rig_file = session_rig(Session.open(folder, require_trials=False))
    before: list[int] = []
    with closing(open_backend(access.backend, rig_file.config)) as bench:
        session = resume_session(
            folder,
            bench,
            opened=before.append,
            progress=progress,
            before_trial=before_trial,
            ask=access.ask,
            predict=predictor(rig_file),
            permission=access.permission(rig_file, bench),
        )
    return session, [trial.number for trial in session.trials if trial.number > before[0]]
