"""From the journal of a trial to its sealed file, part by part: a long trial never is in memory as a whole.

Recorder and recovery both seal trials here, so that a recovered trial is the one that would have been sealed.

Here too: how a session is begun, and what every trial file says of its own origin, so that it stands alone: who, what,
with which devices and programs.
"""

from __future__ import annotations

import contextlib
import functools
import platform
import shutil
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from datetime import datetime, timedelta
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from rig.backend import Backend, Block, Capabilities, check_contract, open_backend
from rig.configuration.profile import Profile
from rig.configuration.rig_file import Rig, RigConfig
from rig.errors import HardwareFault, RigInputError
from rig.recording.options import RecordingOptions
from rig.recording.trial_plan import reject_warm_up
from rig.safety.interrupts import deferred
from rig.session.annotation_file import utc_now
from rig.session.folder import Session, Trial
from rig.session.info import ActionInfo, FileInfo, RoomInfo, SessionInfo
from rig.session.journal.format import Journal, scan_journal, stored_blocks
from rig.session.journal.trial_head import TrialHead
from rig.session.trial_data import TrialData


@contextlib.contextmanager
def new_session(
    out: str | Path, options: RecordingOptions, rig: Rig
) -> Iterator[tuple[Backend, Callable[..., Session]]]:
    """Open the backend of ``options`` where it is an address, and give it with what creates the session of a rig file.

    That takes the copies to keep beside ``session.toml`` and, as keywords, what this kind of session states of itself
    (:class:`SessionInfo`). At the end what was opened here is closed; a session in which nothing was recorded leaves no
    folder behind, one that was there before stays, empty.
    """
    folder, given = Path(out), options.backend
    existed, made = folder.is_dir(), list[Session]()
    backend = open_backend(given, rig.config) if isinstance(given, str) else given

    def create(copies: Mapping[str, str], **stated: Any) -> Session:
        common: dict[str, Any] = {
            "name": folder.name,
            "operator": options.operator,
            "created_utc": utc_now(),
            "simulated": backend.capabilities.simulated,
            "action": options.action or ActionInfo(name=options.action_name),
            "rig": FileInfo(name=rig.config.name, copy_name="rig.toml", sha256=rig.sha256),
            "room": options.room or RoomInfo(),
            "backend": {"name": backend.capabilities.name, **backend.capabilities.description},
            "software": software_versions(),
        }
        notes = {**(options.notes or {}), **stated.pop("notes", {})}
        info = SessionInfo(**{**common, **stated, "notes": notes})
        made.append(Session.create(out, info, {"rig.toml": rig.text, **copies}))
        return made[0]

    check_contract(backend)
    try:
        yield backend, create
    except BaseException:
        if isinstance(given, str):
            with deferred(), contextlib.suppress(HardwareFault):
                backend.close()  # the first fault is the one to report
        raise
    else:
        if isinstance(given, str):
            backend.close()
    finally:
        for session in made:
            with deferred():
                if not session.trials and not session.journals and existed:
                    for path in session.path.iterdir() if session.path.is_dir() else ():
                        path.unlink()
                elif not session.trials and not session.journals:
                    shutil.rmtree(session.path, ignore_errors=True)


PACKAGES = ("piano-action-rig", "numpy", "h5py", "nidaqmx", "grpcio")
JUMP_S = 1.0
"""A wall clock that goes wrong by more against the monotonic one has been set."""


def software_versions() -> dict[str, str]:
    """Return versions of Python, the operating system and the packages a recording depends on.

    Returns
    -------
    dict
        Name to version.

    Examples
    --------
    >>> from rig.recording.sealing import software_versions
    >>> "nidaqmx" in software_versions()
    True
    """
    return {"python": platform.python_version(), "system": platform.platform(), **_package_versions()}


@functools.cache  # they are read from files, 20 ms with every trial otherwise; a running program's do not change
def _package_versions() -> dict[str, str]:
    versions = {}
    for package in PACKAGES:
        with contextlib.suppress(PackageNotFoundError):
            versions[package] = version(package)
    return versions


def trial_provenance(
    info: SessionInfo, capabilities: Capabilities, config: RigConfig, profile: Profile | None
) -> dict[str, str]:
    """Return the origin of a trial that begins now, by name; what is not known is ``unknown`` or left out.

    Devices come with serial numbers where the driver gives them, software as it runs now: a session may be resumed
    with other versions than it began with.
    """
    force = config.force.certificate
    calibrated = {"force": force, **{f"encoder_{e.name}": e.certificate for e in config.encoders}}
    calibrated |= {channel.name: channel.certificate for channel in config.channels}
    return {
        "session": info.name,
        "operator": info.operator,
        "action": info.action.name,
        "action_key": info.action.key,
        "rig": info.rig.name,
        "rig_sha256": info.rig.sha256,
        **({} if profile is None else {"profile": profile.name, "profile_sha256": profile.sha256}),
        "device": config.device.name,
        "backend": capabilities.name,
        **{f"backend_{key}": value for key, value in capabilities.description.items()},
        **{f"calibration_date_{name}": c.date for name, c in calibrated.items() if c is not None},
        **{f"software_{package}": found for package, found in software_versions().items()},
    }


class ClockWatch:
    """Compares the computer's wall clock with its monotonic one; both are read by ``wall_s`` and ``monotonic_s``."""

    def __init__(self, wall_s: Callable[[], float], monotonic_s: Callable[[], float]) -> None:
        self._wall_s, self._monotonic_s = wall_s, monotonic_s
        self._off_s = wall_s() - monotonic_s()

    def jump(self) -> str:
        """Return in words by how much the wall clock was set since the last call; empty where it was not."""
        off_s = self._wall_s() - self._monotonic_s()
        jump_s, self._off_s = off_s - self._off_s, off_s
        if abs(jump_s) <= JUMP_S:
            return ""
        return (
            f"the computer's clock went {'forward' if jump_s > 0 else 'back'} by {abs(jump_s):.1f} s; times of day "
            "before and after do not compare, the samples' times are those of the device and not affected"
        )


PART_SAMPLES = 5_000
PASSIVE = "passive"
"""Name of the profile of what somebody played, and of the settings of its strokes in a trial's provenance."""


@dataclass(frozen=True)
class Cut:
    """The samples of a journal that are a trial: from ``first`` up to ``end``, the stroke noticed at ``trigger``."""

    first: int
    trigger: int
    end: int


def seal_journal(session: Session, file: Path, scanned: Journal, status: str, reason: str) -> Trial:
    """Seal the trial whose journal was scanned; the journal stays.

    A warm-up blow is rejected first: it never counts, whenever the program ends.

    Raises
    ------
    RigInputError
        When the journal cannot be read or has no samples, or the trial cannot be written.
    """
    head = scanned.head
    if head is None or not scanned.n_samples:
        raise RigInputError(f"{file}: has no samples")
    about = replace(
        head.part((), 0),
        status=status,
        reason=reason,
        camera=head.camera(stored_blocks(file, scanned), scanned.n_samples),
    )
    reject_warm_up(session, about)
    return session.add_trial_parts(about, scanned.n_samples, _joined(head, stored_blocks(file, scanned)))


NOTICED_LATE_S = 0.05
"""A stroke begins at most so long before it is noticed, by far: the force has to reach the trigger."""


def seal_cut(session: Session, file: Path, cut: Cut, status: str, reason: str) -> Trial:
    """Seal a stroke that was cut out of a journal: its first sample is time zero, its start time is shifted along.

    Raises as :func:`seal_journal`.
    """
    scanned = scan_journal(file)
    head = scanned.head
    end = min(cut.end, scanned.n_samples)
    if head is None or end <= cut.first:
        raise RigInputError(f"{file}: has no samples")
    rate = head.sample_rate_hz
    started = datetime.fromisoformat(head.started_utc) + timedelta(seconds=cut.first / rate)
    head = replace(
        head,
        started_utc=started.isoformat(timespec="milliseconds"),
        blow_start_s=max((cut.trigger - cut.first) / rate - NOTICED_LATE_S, 0.0),
    )
    about = replace(head.part((), 0), status=status, reason=reason)
    blocks = _inside(stored_blocks(file, scanned), cut.first, end)
    return session.add_trial_parts(about, end - cut.first, _joined(head, blocks))


def _inside(blocks: Iterator[Block], first: int, end: int) -> Iterator[Block]:
    """Yield the samples from ``first`` up to ``end``, numbered from 0."""
    for block in blocks:
        low, high = max(first - block.first_sample, 0), min(end - block.first_sample, block.force_n.size)
        if low >= high:
            continue
        values = block.channel_values
        yield Block(
            block.first_sample + low - first,
            block.force_n[low:high],
            block.force_raw[low:high],
            block.encoder_count[low:high],
            None,
            None if values is None else values[low:high],
        )


def _joined(head: TrialHead, blocks: Iterator[Block]) -> Iterator[TrialData]:
    waiting: list[Block] = []
    first = samples = 0
    for block in blocks:
        waiting.append(block)
        samples += block.force_n.size
        if samples - first >= PART_SAMPLES:
            yield head.part(waiting, first)
            waiting, first = [], samples
    if waiting:
        yield head.part(waiting, first)
