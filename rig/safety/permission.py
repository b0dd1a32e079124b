"""Permission to move the motor of a real bench: somebody confirmed, and a self-test of this rig file passed.

The command line asks the operator and gets a :class:`Permission`; without one the recorder refuses to touch hardware
(``ni://``, ``ni-grpc://``). The virtual bench needs none. Nothing has moved after a refusal
(:class:`rig.errors.NotPermitted`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from rig.backend import Capabilities
from rig.configuration.rig_file import Rig, RigConfig
from rig.errors import NotPermitted
from rig.selftest import SelftestRecord, bench_of, valid_record


@dataclass(frozen=True)
class Permission:
    """How it was confirmed (``typed`` or ``--yes``), for which rig file, and on which self-test."""

    how: str
    rig_sha256: str
    selftest: SelftestRecord | None

    def session_notes(self) -> dict[str, str]:
        """Return the notes for the session file."""
        record = self.selftest
        if record is None:
            return {"permission": self.how}
        found = "; ".join(f"{finding.check}: {finding.found}" for finding in record.findings)
        return {"permission": self.how, "selftest": f"{record.created_utc.isoformat()} {found}"}

    noted = session_notes  # its former name, for one release

    def applied_to(self, config: RigConfig) -> RigConfig:
        """Return the rig's settings with what the self-test measured: the unloaded reading of the load cell."""
        if self.selftest is None or self.selftest.unloaded_n is None or config.force.offset_n is not None:
            return config
        force = config.force.model_copy(update={"offset_n": self.selftest.unloaded_n})
        return config.model_copy(update={"force": force})


def confirm(rig: Rig, address: str, *, yes: bool, ask: Callable[[str], str | None] | None) -> str:
    """Let the operator confirm that the motor may move by typing the rig's name; return ``typed``, or ``--yes`` where
    ``yes`` is given and the rig file allows it. ``ask`` returns what was typed, None: nobody there. NotPermitted
    otherwise."""
    name = rig.config.name
    if yes:
        if not rig.config.safety.allow_yes:
            raise NotPermitted(
                f"{rig.source}: `yes` is not permitted (safety.allow_yes = false); confirm by typing the rig's name"
            )
        return "--yes"
    question = f"The motor at {address} will move. Nobody near the arm? Type the rig's name, {name}, to go on: "
    typed = None if ask is None else ask(question)
    if typed is None:
        raise NotPermitted(f"{address}: nobody to confirm that the motor may move; run it in a terminal, or see `yes`")
    if typed.strip() != name:
        raise NotPermitted(f"{address}: typed {typed.strip()!r}, expected {name!r}; nothing has moved")
    return "typed"


def permit(
    rig: Rig,
    address: str,
    selftests: Path,
    *,
    yes: bool,
    ask: Callable[[str], str | None] | None,
    now: datetime | None = None,
) -> Permission:
    """Return the permission to move the motor at ``address``: find a valid self-test of this rig file in ``selftests``,
    then let the operator confirm by ``ask``, or by ``yes`` where the rig file allows it. NotPermitted otherwise;
    nothing moves.

    Parameters
    ----------
    rig : Rig
    address : str
        Of the backend, for the question.
    selftests : Path
        Record of a self-test, or the folder of them.
    yes : bool
        ``--yes`` was given; counts only where ``safety.allow_yes`` of the rig file is true.
    ask : callable or None
        Shows a question and returns what was typed; None when nobody can be asked.
    now : datetime, optional
        Time at which the self-test must be valid; by default the computer's.

    Returns
    -------
    Permission

    Raises
    ------
    NotPermitted
        No valid self-test of this rig file, or not confirmed; the message says what is missing.

    Examples
    --------
    >>> from pathlib import Path
    >>> import rig
    >>> try:
    ...     rig.permit(rig.load_rig("virtual"), "ni://local", Path("selftests"), yes=False, ask=None)
    ... except rig.NotPermitted:
    ...     print("run the self-test first")
    run the self-test first
    """
    _, record = valid_record(rig, selftests, now, address=address)
    return Permission(confirm(rig, address, yes=yes, ask=ask), rig.sha256, record)


def require_permission(rig: Rig, capabilities: Capabilities, permission: Permission | None, dry_run: bool) -> None:
    """Refuse, by NotPermitted, a backend that moves hardware without a permission for this rig file, a self-test passed
    on this bench and a ``dry_run``; one that moves none needs nothing."""
    if not capabilities.hardware:
        return
    if permission is None:
        raise NotPermitted(f"{capabilities.name}: moving hardware needs a permission (rig.safety.permission.permit)")
    if permission.rig_sha256 != rig.sha256:
        raise NotPermitted(f"{capabilities.name}: the permission is for another rig file than {rig.source}")
    record = permission.selftest
    if record is None or not record.passed:
        raise NotPermitted(f"{capabilities.name}: recording needs a self-test that passed; run  pianorig selftest")
    if record.bench != (here := bench_of(capabilities)):
        raise NotPermitted(
            f"{capabilities.name}: is a {here}; the self-test was made on a {record.bench}; "
            f"run  pianorig selftest --backend ADDRESS --rig {rig.source}  on this one"
        )
    if not dry_run:
        raise NotPermitted(f"{capabilities.name}: recording needs a dry run of the profile (predict)")
