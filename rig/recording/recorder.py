"""The recorder: a session of trials from one profile or a plan, checked before anything moves, safe on every way out.

Ctrl-C, SIGTERM and faults stop the bench safely; what was recorded stays and is marked, and the exception goes on to
the caller. When not one trial was recorded, no session folder is left. A program that is killed leaves a journal, see
:mod:`rig.recording.recover`.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Unpack

from rig.configuration.motor_command import motor_command
from rig.configuration.profile import Profile, load_profile
from rig.configuration.rig_file import Rig, load_rig
from rig.keywords import refuse_unknown
from rig.recording.begin_session import new_session
from rig.recording.options import RecordingKeywords, RecordingOptions
from rig.recording.record_entries import record_entries
from rig.recording.trial_plan import plain_plan
from rig.safety.dry_run import dry_run
from rig.safety.permission import require_permission
from rig.session.folder import Session
from rig.session.info import ActionInfo, FileInfo, RoomInfo


def record(out: str | Path, options: RecordingOptions | None = None, **keywords: Unpack[RecordingKeywords]) -> Session:
    """Record trials of a profile or a plan in a new session folder, checked before anything moves; return the session.

    Parameters
    ----------
    out : path
        Session folder to create; must not exist, or be empty.
    options : RecordingOptions, optional
        All that follows as one record; keywords given as well replace its fields.
    profile, rig_config : object, built-in name or path
        What the motor does (default ``forte``); the bench (``virtual``).
    backend : Backend or str
        An open backend (stays open), or an address to open and close (``sim://``).
    trials : int
        Number of trials, 1 to 9999 (5).
    plan : Plan, optional
        A trial plan (:mod:`rig.recording.trial_plan`) in place of ``profile`` and ``trials``.
    operator, action_name, action, room, notes
        What goes into ``session.toml``; ``action`` replaces ``action_name``.
    progress : callable, optional
        Called after each block with a :class:`rig.recording.options.Progress`; an exception in it stops the trial
        safely.
    before_trial : callable, optional
        Called with a trial's number when the rest before it is over and its prompt answered; the outputs are safe, and
        the trial begins when it returns. An exception in it ends the session there.
    after_trial : callable, optional
        Called with each sealed trial while the backend is still open, e.g. to save a film.
    feed : BlockFeed, optional
        Bounded feed for a live view.
    ask : callable, optional
        Shows an operator prompt and returns what was typed, None when nobody can be asked.
    predict : callable, optional
        Predicts the profile's blow for the dry run (:mod:`rig.safety.dry_run`); needed on hardware.
    permission : Permission, optional
        That the motor may move (:mod:`rig.safety.permission`); needed on hardware, i.e. with ``ni://`` and
        ``ni-grpc://``.
    open_journal : callable
        Creates each trial's journal; tests put a bad disk here.
    now_s, wall_s : callable
        Monotonic clock of the time left, s, and the wall clock that is held against it.

    Returns
    -------
    Session

    Raises
    ------
    RigInputError
        Bad profile, rig file, number of trials or path, or a dry run outside the limits; nothing has moved and nothing
        is left behind.
    NotPermitted
        Hardware without permission, self-test or dry run; likewise.
    HardwareFault
        The bench stopped; earlier trials and the marked one are kept.
    KeyboardInterrupt
        The operator stopped; likewise.

    Examples
    --------
    >>> import rig
    >>> session = rig.record("sessions/two", profile="forte", trials=2, operator="me")
    >>> print(f"{session[1].force_n.max():.0f} N")
    33 N
    """
    refuse_unknown("rig.record", keywords, RecordingKeywords.__annotations__)
    given = replace(options or RecordingOptions(), **keywords)
    rig = given.rig_config if isinstance(given.rig_config, Rig) else load_rig(given.rig_config)
    profile = given.profile if isinstance(given.profile, Profile) else load_profile(given.profile)
    plan = given.plan or plain_plan(profile, given.trials)
    config = given.permission.applied_to(rig.config) if given.permission is not None else rig.config
    predicted: dict[str, float | str] = {}
    for profile in plan.profiles.values():
        motor_command(profile, config)
        found = dry_run(profile, config, given.predict) if given.predict is not None else {}
        predicted = predicted or found
    with new_session(out, given, rig) as (backend, create):
        require_permission(rig, backend.capabilities, given.permission, given.predict is not None)
        first = plan.entries[0]
        session = create(
            plan.files(),
            action=given.action or plan.action or ActionInfo(name=given.action_name),
            profile=FileInfo(
                name=first.profile.name, copy_name=plan.copies[first.condition], sha256=first.profile.sha256
            ),
            plan=plan.info(),
            room=given.room or plan.room or RoomInfo(),
            notes=given.permission.session_notes() if given.permission else {},
            dry_run=predicted,
        )
        record_entries(session, backend, config, plan.entries, given)
    return session
