"""What is left of a session's plan, and its recording, also where trials were rejected.

A trial is never rewritten: a repeated one gets the next free number, the earlier one stays. An entry of the plan is
done when it has a trial that ended by itself (``complete``, ``not at rest``) and is not rejected; a warm-up blow counts
as done although it is rejected. Rig file and profiles are the copies in the session.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Unpack

from rig.atomic_write import sha256_of_bytes
from rig.backend import Backend, check_contract
from rig.configuration import toml_file
from rig.configuration.profile import parse_profile
from rig.configuration.rig_file import Rig, parse_rig
from rig.errors import RigInputError
from rig.keywords import make_options
from rig.recording.options import RecordingOptions, ResumeKeywords
from rig.recording.record_entries import record_entries
from rig.recording.recover import recover
from rig.recording.trial_plan import WARM_UP_REASON, Entry
from rig.safety.dry_run import dry_run
from rig.safety.permission import require_permission
from rig.session.folder import Session
from rig.session.info import FileInfo
from rig.session.seal import OPEN_ELSEWHERE

ENDED = ("complete", "not at rest")


def due_entries(session: Session) -> list[Entry]:
    """Return, in order, the entries of a session's plan that have no trial that ended by itself (``complete``, ``not at
    rest``) and is not rejected; a warm-up blow counts although it is rejected."""
    plan = session.info.plan
    every = _read_planned_entries(session)
    for trial in session.trials:
        if trial.problem.endswith(OPEN_ELSEWHERE):
            raise RigInputError(f"{trial.problem}, then resume: what it holds of the plan is not known")
    done = [
        trial.read().plan_entry
        for trial in session.trials
        if trial.status in ENDED and trial.rejected in (None, "", WARM_UP_REASON)
    ]
    if not plan.order:
        return every[len(done) :]
    return [entry for entry in every if entry.number not in done]


def _read_planned_entries(session: Session) -> list[Entry]:
    """All planned trials of a session in order, with profiles parsed from its copies."""
    plan = session.info.plan
    if not plan.order:
        profile = parse_profile(_read_copy(session, session.info.profile), f"{session.path / 'profile.toml'}")
        return [Entry(k, "", profile) for k in range(1, plan.trials + 1)]
    by_name = {condition.name: condition for condition in plan.conditions}
    missing = set(plan.order) - set(by_name)
    if missing:
        raise RigInputError(f"{session.path}: plan.order names {sorted(missing)}, which is not among plan.conditions")
    profiles = {
        name: parse_profile(_read_copy(session, condition.profile), str(session.path / condition.profile.copy_name))
        for name, condition in by_name.items()
    }
    return [
        Entry(k + 1, name, profiles[name], k < plan.warm_up, by_name[name].prompt) for k, name in enumerate(plan.order)
    ]


def _read_copy(session: Session, file: FileInfo) -> str:
    """Return the text of a copy in the session, after checking that it is the one the session was made with."""
    if not file.copy_name or Path(file.copy_name).name != file.copy_name:
        raise RigInputError(f"{session.path}: {file.name}: no copy is kept beside session.toml; record a new session")
    path = session.path / file.copy_name
    text = toml_file.read_text(path)
    if file.sha256 and sha256_of_bytes(text.encode("utf-8")) != file.sha256:
        raise RigInputError(
            f"{path}: is not the file the session was begun with; put that back, or record a new session"
        )
    return text


def session_rig(session: Session) -> Rig:
    """Return the rig file a session was begun with.

    Parameters
    ----------
    session : Session

    Returns
    -------
    Rig

    Raises
    ------
    RigInputError
        When the session's copy of it is missing or was changed.

    Examples
    --------
    >>> import rig
    >>> rig.session_rig(rig.Session.open("sessions/example_forte")).config.name
    'virtual'
    """
    return parse_rig(_read_copy(session, session.info.rig), str(session.path / session.info.rig.copy_name))


def resume(
    path: str | Path,
    backend: Backend,
    *,
    opened: Callable[[int], None] | None = None,
    **keywords: Unpack[ResumeKeywords],
) -> Session:
    """Recover what was cut off, then record what is left of a session's plan; return the session.

    Parameters
    ----------
    path : path
        Session folder.
    backend : Backend
        Of the session's rig file (:func:`session_rig`); simulated or not as the session is.
    opened : callable, optional
        Called with the number of the last trial there is, before the first new one.
    **keywords
        ``progress``, ``before_trial``, ``after_trial``, ``feed``, ``ask``, ``predict``, ``permission``,
        ``open_journal``, ``now_s`` and ``wall_s`` as for :func:`rig.recording.recorder.record`.

    Returns
    -------
    Session

    Raises
    ------
    RigInputError
        No session, nothing left to record, or copies that were changed; nothing has moved.
    HardwareFault, KeyboardInterrupt
        As when recording.
    TypeError
        A keyword that is not known.

    Examples
    --------
    >>> import rig
    >>> def stop_at_trial_2(at):
    ...     if at.trial == 2:
    ...         raise KeyboardInterrupt
    >>> try:
    ...     rig.record("half", profile="forte", trials=2, progress=stop_at_trial_2)
    ... except KeyboardInterrupt:
    ...     half = rig.Session.open("half")
    >>> bench = rig.open_backend("sim://", rig.session_rig(half).config)
    >>> [trial.status for trial in rig.resume("half", bench).trials]
    ['complete', 'interrupted', 'complete']
    >>> bench.close()
    """
    if unknown := sorted(set(keywords) - set(ResumeKeywords.__annotations__)):
        raise TypeError(f"resume() got unexpected keyword arguments {', '.join(unknown)}")
    options = make_options(RecordingOptions, "rig.resume", keywords)
    check_contract(backend)
    recover(path)
    session = Session.open(path, require_trials=False)
    if session.info.simulated != backend.capabilities.simulated:
        raise RigInputError(
            f"{session.path}: simulated = {session.info.simulated}, but the backend {backend.capabilities.name} is "
            f"{'' if backend.capabilities.simulated else 'not '}simulated; a session is one or the other"
        )
    due = due_entries(session)
    if not due:
        raise RigInputError(f"{session.path}: every trial of its plan is there; nothing to resume")
    rig, permission = session_rig(session), options.permission
    require_permission(rig, backend.capabilities, permission, options.predict is not None)
    config = permission.applied_to(rig.config) if permission is not None else rig.config
    if options.predict is not None:
        for profile in {entry.condition: entry.profile for entry in due}.values():
            dry_run(profile, config, options.predict)
    last = max((trial.number for trial in session.trials), default=0)
    if opened is not None:
        opened(last)
    backend.continue_after(last)
    record_entries(session, backend, config, due, options, first_number=last + 1)
    return session
