"""Recording a felt: a slow ramp first, then each speed with each peak force, shaped from what the ramp found.

Everything a blow has is there too: permission, watchdog, interlocks, journal, sealed trials; the limits of travel and
force are the felt's. The curves go to ``derived/felt/`` of the session.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Unpack

import numpy as np
from numpy.typing import NDArray

from rig.backend import Backend, Capabilities
from rig.calibration.rig_text import changed
from rig.configuration.felt_setup import FeltConfig
from rig.configuration.profile import Profile
from rig.configuration.rig_file import Rig, RigConfig, load_rig, parse_rig
from rig.errors import RigInputError
from rig.felt.block import Compliance, compliance
from rig.felt.order import BLOCK, FeltOrder, checked, guarded
from rig.felt.press_curve import PressCurve, press_curve
from rig.felt.profiles import at_speed, checked_command, ramp
from rig.felt.readings import readings
from rig.recording.empty_session import discard_empty
from rig.recording.options import RecordingKeywords, RecordingOptions
from rig.recording.own_backend import recording_backend
from rig.recording.provenance import software_versions
from rig.recording.trial_plan import Entry
from rig.recording.trial_sequence import record_entries
from rig.safety.permission import require_permission
from rig.session.annotation_file import utc_now
from rig.session.folder import Session, Trial
from rig.session.info import ActionInfo, FileInfo, PlanInfo, RoomInfo, SessionInfo
from rig.storage.atomic_write import write_text
from rig.storage.file_errors import refused

FOLDER = Path("derived") / "felt"
BLOCK_PRESSES = 3


@dataclass(frozen=True, eq=False)
class FeltPress:
    """A press: its trial, its curve, and the file for ``calibrate-felt``."""

    trial: int
    curve: PressCurve
    file: Path


@dataclass(frozen=True, eq=False)
class FeltSession:
    """The session with its presses of a felt, or for a block the compliance and the rig file that follows."""

    session: Session
    presses: tuple[FeltPress, ...] = ()
    compliance: Compliance | None = None
    rig_text: str = ""


def record_felt(out: str | Path, order: FeltOrder, **keywords: Unpack[RecordingKeywords]) -> FeltSession:
    """Press a felt, or the block, and evaluate it.

    Parameters
    ----------
    out : path
        Session folder to create; must not exist, or be empty.
    order : FeltOrder
        What is pressed, how fast and how hard.
    **keywords
        As for :func:`rig.recording.recorder.record`, without profile, plan, trials and predict: the dry run of a press
        needs no model.

    Returns
    -------
    FeltSession

    Raises
    ------
    RigInputError
        Bad rig file, order or path, a felt too hard for a speed, or readings that cannot be evaluated.
    NotPermitted
        Hardware without permission or self-test.
    HardwareFault
        The bench stopped, or a limit was exceeded; earlier presses are kept.

    Examples
    --------
    >>> import rig
    >>> order = rig.FeltOrder("contact02", speeds_m_per_s=(0.01,), peaks_n=(20.0,))
    >>> done = rig.record_felt("sessions/felt", order, backend="sim://?felt=contact02")
    >>> print(f"{done.presses[0].curve.peak_n:.0f} N")
    20 N
    """
    options = RecordingOptions(**keywords)
    rig = options.rig_config if isinstance(options.rig_config, Rig) else load_rig(options.rig_config)
    felt = checked(order, rig.config, rig.source)
    known = options.permission.applied_to(rig.config) if options.permission is not None else rig.config
    press = _Press(order, rig, guarded(known, felt, max(order.peaks_n)), felt, options)
    press.command(ramp(max(order.peaks_n)))
    existed = Path(out).is_dir()
    session: Session | None = None
    try:
        with recording_backend(options.backend, rig.config) as backend:
            require_permission(rig, backend.capabilities, options.permission, dry_run=True)
            session = Session.create(out, press.info(Path(out).name, backend.capabilities), {"rig.toml": rig.text})
            return press.block(session, backend) if order.contact == BLOCK else press.felt(session, backend)
    finally:
        if session is not None:
            discard_empty(session, existed)


@dataclass(frozen=True, eq=False)
class _Press:
    order: FeltOrder
    rig: Rig
    config: RigConfig
    setup: FeltConfig
    options: RecordingOptions

    @property
    def count(self) -> int:
        """Trials in all."""
        order = self.order
        return (
            BLOCK_PRESSES
            if order.contact == BLOCK
            else 1 + len(order.speeds_m_per_s) * len(order.peaks_n) * order.repeats
        )

    def info(self, name: str, capabilities: Capabilities) -> SessionInfo:
        options, order = self.options, self.order
        return SessionInfo(
            name=name,
            kind="felt",
            operator=options.operator,
            created_utc=utc_now(),
            simulated=capabilities.simulated,
            action=options.action or ActionInfo(name=options.action_name),
            rig=FileInfo(name=self.rig.config.name, copy_name="rig.toml", sha256=self.rig.sha256),
            profile=FileInfo(name=f"felt {order.contact}"),
            plan=PlanInfo(trials=self.count, rest_s=order.rest_s),
            room=options.room or RoomInfo(),
            backend={"name": capabilities.name, **capabilities.description},
            software=software_versions(),
            notes={
                **(options.notes or {}),
                "recording": f"the arm pressed {order.contact}, no key; scale of the {self.setup.encoder} on its shaft",
                **(options.permission.noted() if options.permission else {}),
            },
        )

    def command(self, profile: Profile) -> None:
        body = [encoder.name for encoder in self.config.encoders].index(self.setup.encoder)
        checked_command(profile, self.config, 0.99 * self.config.limits.travel_rad[body], body)

    def evaluated(self, session: Session, trial: Trial) -> FeltPress:
        """Evaluate a press and write its curve."""
        curve = press_curve(trial.read(), self.setup)
        folder = session.path / FOLDER
        with refused(folder, "created"):
            folder.mkdir(parents=True, exist_ok=True)
        file = folder / f"trial_{trial.number:04d}.csv"
        write_text(file, curve.table())
        return FeltPress(trial.number, curve, file)

    def play(
        self,
        session: Session,
        backend: Backend,
        profiles: Sequence[Profile],
        first: int,
        options: RecordingOptions | None = None,
    ) -> None:
        """Record these presses as the trials from ``first`` on."""
        for profile in profiles:
            self.command(profile)
        entries = [Entry(first + k, f"press-{first + k}", profile) for k, profile in enumerate(profiles)]
        for entry in entries:
            write_text(session.path / f"profile_{entry.number:04d}.toml", entry.profile.text)
        record_entries(session, backend, self.config, entries, options or self.options, first_number=first)

    def block(self, session: Session, backend: Backend) -> FeltSession:
        self.play(session, backend, [ramp(max(self.order.peaks_n))] * BLOCK_PRESSES, 1)
        found = compliance([trial.read() for trial in session.trials], self.setup)
        values = {"compliance_m_per_n": found.m_per_n, "u_compliance_m_per_n": found.u_m_per_n}
        text = changed(self.rig.text, "felt", {key: float(f"{value:.6g}") for key, value in values.items()})
        parse_rig(text, f"{self.rig.source} with the compliance found")
        return FeltSession(session, compliance=found, rig_text=text)

    def felt(self, session: Session, backend: Backend) -> FeltSession:
        order = self.order
        self.play(session, backend, [ramp(max(order.peaks_n))], 1)
        moved, force = _rising(session, self.setup)
        slew = self.config.motor.slew_limit_n_per_s
        shaped = [
            at_speed(moved, force, speed, peak, slew)
            for peak in order.peaks_n
            for speed in order.speeds_m_per_s
            for _ in range(order.repeats)
        ]
        backend.wait(order.rest_s)
        presses: list[FeltPress] = []

        def evaluate(trial: Trial) -> None:
            # at once: what ends the recording later takes no curve with it
            presses.append(self.evaluated(session, trial))
            if self.options.after_trial is not None:
                self.options.after_trial(trial)

        self.play(session, backend, shaped, 2, replace(self.options, after_trial=evaluate))
        return FeltSession(session, tuple(presses))


def _rising(session: Session, felt: FeltConfig) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Compression since rest and force above the preload while the ramp loads, both rising from zero."""
    trial = session.trials[0].read()
    read = readings(trial, felt, lowest=0.0)
    force = read.force_n[read.loading] - trial.force_info.preload_n
    moved = read.moved_m[read.loading] - felt.compliance_m_per_n * force
    order = np.argsort(force)
    force, moved = force[order], np.maximum.accumulate(moved[order])
    above = (force > 0) & (moved > 0)
    if above.sum() < 10:
        raise RigInputError("felt: the ramp moved nothing; is the arm on the felt, the drive on?")
    return np.concatenate(([0.0], moved[above])), np.concatenate(([0.0], force[above]))
