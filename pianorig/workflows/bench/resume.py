"""Going on with an interrupted session on the bench it was begun on."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rig.session import Session


def resume(
    folder: Path,
    *,
    backend: str = "sim://",
    progress: Callable[[Any], None] | None = None,
    yes: bool = False,
    ask: Callable[[str], str | None] | None = None,
    selftests: Path = Path("selftests"),
) -> tuple[Session, list[int]]:
    """Record what is left of a session's plan; return the session and the numbers of the new trials.

    Raises
    ------
    rig.errors.RigError : nothing left, another kind of bench, or the bench stopped
    """
    from pianorig.workflows.model.predict_blow import predictor
    from rig.backend import open_backend
    from rig.recording.resume import resume_session, session_rig
    from rig.safety.permission import permit
    from rig.session import Session

    rig_file = session_rig(Session.open(folder, require_trials=False))
    bench = open_backend(backend, rig_file.config)
    before: list[int] = []
    try:
        permission = None
        if bench.capabilities.hardware:
            permission = permit(rig_file, backend, selftests, yes=yes, ask=ask)

        session = resume_session(
            folder,
            bench,
            progress=progress,
            ask=ask,
            predict=predictor(rig_file),
            permission=permission,
            opened=before.append,
        )
    finally:
        bench.close()
    return session, [trial.number for trial in session.trials if trial.number > before[0]]
