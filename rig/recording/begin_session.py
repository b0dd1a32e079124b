"""Begin a session: open the backend where it is an address, and create the folder with what it states of itself."""

from __future__ import annotations

import contextlib
import shutil
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

from rig.backend import Backend, check_contract, open_backend
from rig.configuration.rig_file import Rig
from rig.errors import HardwareFault
from rig.recording.options import RecordingOptions
from rig.recording.provenance import software_versions
from rig.safety.interrupts import defer_interrupts
from rig.session.annotation_file import utc_now
from rig.session.folder import Session
from rig.session.info import ActionInfo, FileInfo, RoomInfo, SessionInfo


@contextlib.contextmanager
def new_session(
    out: str | Path, options: RecordingOptions, rig: Rig
) -> Iterator[tuple[Backend, Callable[..., Session]]]:
    """Yield the backend of ``options``, opened here from an address, and ``create(copies, **stated)``, which makes the
    session in folder ``out``; at the end close what was opened here and remove a session without a trial or journal.

    ``create`` takes the texts to keep beside ``session.toml``, by file name, and, as keywords, what this kind of
    session states of itself (:class:`SessionInfo`). A session in which nothing was recorded leaves no folder behind;
    one that was there before stays, empty.
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
            with defer_interrupts(), contextlib.suppress(HardwareFault):
                backend.close()  # the first fault is the one to report
        raise
    else:
        if isinstance(given, str):
            backend.close()
    finally:
        for session in made:
            with defer_interrupts():
                if not session.trials and not session.journals and existed:
                    for path in session.path.iterdir() if session.path.is_dir() else ():
                        path.unlink()
                elif not session.trials and not session.journals:
                    shutil.rmtree(session.path, ignore_errors=True)
