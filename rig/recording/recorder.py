"""The recorder: a session of trials from one profile or a plan, checked before anything moves, safe on every way out.

Place in the data flow: profile and rig file → backend → session folder. Ctrl-C, SIGTERM and faults stop the bench
safely; what was recorded is kept and marked, and the exception goes on to the caller. When not one trial was recorded,
no session folder is left. A program that is killed leaves a journal, see :mod:`rig.recording.recover`.
"""

from __future__ import annotations

import contextlib
import platform
import shutil
from collections.abc import Callable, Mapping
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from rig.backend import Backend, open_backend
from rig.configuration.profile import Profile, load_profile
from rig.configuration.rig_file import Rig, load_rig
from rig.errors import HardwareFault
from rig.recording.dry_run import Predict, dry_run
from rig.recording.feed import BlockFeed
from rig.recording.interrupts import deferred
from rig.recording.permission import Permission, demand
from rig.recording.plan_run import Attendance, play
from rig.recording.trial_plan import Plan, plain_plan
from rig.recording.trial_run import OpenJournal, Progress, motor_command
from rig.session import Session, SessionInfo, Trial
from rig.session.annotation_file import utc_now
from rig.session.info import ActionInfo, FileInfo, RoomInfo
from rig.session.journal import JournalWriter

PACKAGES = ("piano-action-rig", "numpy", "h5py", "nidaqmx", "grpcio")


def record_session(
    out: str | Path,
    *,
    profile: Profile | str | Path = "forte",
    rig_config: Rig | str | Path = "virtual",
    backend: Backend | str = "sim://",
    trials: int = 5,
    operator: str = "unknown",
    action_name: str = "unknown",
    action: ActionInfo | None = None,
    room: RoomInfo | None = None,
    notes: Mapping[str, str] | None = None,
    progress: Callable[[Progress], None] | None = None,
    after_trial: Callable[[Trial], None] | None = None,
    feed: BlockFeed | None = None,
    open_journal: OpenJournal = JournalWriter,
    predict: Predict | None = None,
    permission: Permission | None = None,
    plan: Plan | None = None,
    ask: Callable[[str], str | None] | None = None,
) -> Session:
    """Record a session.

    Parameters
    ----------
    out : path
        Session folder to create; must not exist, or be empty.
    profile, rig_config : object, built-in name or path
        What the motor does; the bench.
    backend : Backend or str
        An open backend (stays open), or an address to open and close.
    trials : int
        Number of trials, 1 to 9999.
    plan : Plan, optional
        A trial plan (:mod:`rig.recording.trial_plan`) in place of ``profile`` and ``trials``.
    operator, action_name, action, room, notes
        What goes into ``session.toml``; ``action`` replaces ``action_name``.
    progress, after_trial, feed, ask, open_journal : optional
        Who watches, and what is done around the blows: see :class:`rig.recording.plan_run.Attendance`.
    predict : callable, optional
        Predicts the profile's blow for the dry run (:mod:`rig.recording.dry_run`); needed on hardware.
    permission : Permission, optional
        That the motor may move (:mod:`rig.recording.permission`); needed on hardware, i.e. with ``ni://`` and ``ni-grpc://``.

    Returns
    -------
    Session

    Raises
    ------
    InputError
        Bad profile, rig file, number of trials or path, or a dry run outside the limits; nothing has moved and nothing
        is left behind.
    NotPermitted
        Hardware without permission, self-test or dry run; likewise.
    HardwareFault
        The bench stopped; earlier trials and the marked one are kept.
    KeyboardInterrupt
        The operator stopped; likewise.
    """
    rig = rig_config if isinstance(rig_config, Rig) else load_rig(rig_config)
    if plan is None:
        plan = plain_plan(profile if isinstance(profile, Profile) else load_profile(profile), trials)
    config = permission.applied_to(rig.config) if permission is not None else rig.config
    first = plan.entries[0].profile
    predicted: dict[str, float | str] = {}
    for chosen in plan.profiles.values():
        motor_command(chosen, config)
        found = dry_run(chosen, config, predict) if predict is not None else {}
        predicted = predicted or found
    existed = Path(out).is_dir()
    opened = open_backend(backend, rig.config) if isinstance(backend, str) else backend
    session: Session | None = None
    attendance = Attendance(progress, after_trial, feed, ask, open_journal)
    try:
        demand(rig, opened.capabilities, permission, predict is not None)
        info = _session_info(
            Path(out).name, opened, first, rig, plan, operator,
            action or plan.action or ActionInfo(name=action_name), room or plan.room,
            {**(notes or {}), **(permission.noted() if permission else {})}, predicted,
        )  # fmt: skip
        session = Session.create(out, info, {"rig.toml": rig.text, **plan.files()})
        play(session, opened, config, plan.entries, 1, plan.rest_s, attendance)
    except BaseException:
        if isinstance(backend, str):
            with deferred(), contextlib.suppress(HardwareFault):
                opened.close()  # the first fault is the one to report
        raise
    else:
        if isinstance(backend, str):
            opened.close()
    finally:
        with deferred():
            if session is not None and not session.trials and not session.journals:
                _discard(session, existed)
    return session


def _session_info(
    name: str,
    backend: Backend,
    profile: Profile,
    rig: Rig,
    plan: Plan,
    operator: str,
    action: ActionInfo,
    room: RoomInfo | None,
    notes: Mapping[str, str] | None,
    predicted: Mapping[str, float | str],
) -> SessionInfo:
    capabilities = backend.capabilities
    return SessionInfo(
        name=name,
        operator=operator,
        created_utc=utc_now(),
        simulated=capabilities.simulated,
        action=action,
        rig=FileInfo(name=rig.config.name, copy_name="rig.toml", sha256=rig.sha256),
        profile=FileInfo(name=profile.name, copy_name=plan.copies[plan.entries[0].condition], sha256=profile.sha256),
        plan=plan.info(),
        room=room or RoomInfo(),
        backend={"name": capabilities.name, **capabilities.description},
        software=software_versions(),
        notes=dict(notes or {}),
        dry_run=dict(predicted),
    )


def software_versions() -> dict[str, str]:
    """Return versions of Python, the operating system and the packages a recording depends on."""
    versions = {"python": platform.python_version(), "system": platform.platform()}
    for package in PACKAGES:
        with contextlib.suppress(PackageNotFoundError):
            versions[package] = version(package)
    return versions


def _discard(session: Session, existed: bool) -> None:
    """Remove a session without trials; a folder that was there before stays, empty."""
    if existed:
        for path in session.path.iterdir():
            path.unlink()
    else:
        shutil.rmtree(session.path, ignore_errors=True)
