"""Record presses of a felt, or of the block, in a session, and evaluate each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Unpack

import numpy as np
from numpy.typing import NDArray

from rig.atomic_write import translate_os_error, write_text
from rig.backend import Backend
from rig.configuration.profile import Profile
from rig.configuration.rig_file import FeltConfig, Rig, RigConfig, load_rig, parse_rig
from rig.configuration.rig_file_edit import change_table
from rig.errors import RigInputError
from rig.felt.arm_compliance import Compliance, measure_compliance
from rig.felt.order import BLOCK, FeltOrder, check_order, check_press, press_settings
from rig.felt.press_curve import PressCurve, fit_press_curve
from rig.felt.press_profile import make_constant_speed_press, make_ramp
from rig.felt.readings import FEWEST_POINTS, read_press
from rig.keywords import make_options
from rig.recording.begin_session import new_session
from rig.recording.options import RecordingKeywords, RecordingOptions
from rig.recording.record_entries import record_entries
from rig.recording.trial_plan import Entry
from rig.safety.permission import require_permission
from rig.session.folder import Session, Trial
from rig.session.info import FileInfo, PlanInfo

FOLDER = Path("derived") / "felt"
BLOCK_PRESSES = 3  # of the steel block, whose slopes' scatter is the compliance's uncertainty


@dataclass(frozen=True, eq=False)
class FeltPress:
    """A press: its trial, its curve, and the file for ``calibrate felt``."""

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
    """Press a felt with the motor arm into a new session folder, a ramp, then each speed and peak of ``order``, whose
    curves are written; or press the steel block and find the arm's compliance, with a new rig file's text.

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
    options = make_options(RecordingOptions, "rig.record_felt", keywords)
    rig = options.rig_config if isinstance(options.rig_config, Rig) else load_rig(options.rig_config)
    felt = check_order(order, rig.config, rig.source)
    config = options.permission.applied_to(rig.config) if options.permission is not None else rig.config
    press = _Press(order, rig, press_settings(config, felt, max(order.peaks_n)), felt, options)
    press.check(make_ramp(max(order.peaks_n)))
    with new_session(out, options, rig) as (backend, create):
        require_permission(rig, backend.capabilities, options.permission, dry_run=True)
        session = create({}, **press.session_statement())
        return press.record_block(session, backend) if order.contact == BLOCK else press.record_felt(session, backend)


@dataclass(frozen=True, eq=False)
class _Press:
    order: FeltOrder
    rig: Rig
    config: RigConfig
    setup: FeltConfig
    options: RecordingOptions

    @property
    def count(self) -> int:
        order = self.order
        return (
            BLOCK_PRESSES
            if order.contact == BLOCK
            else 1 + len(order.speeds_m_per_s) * len(order.peaks_n) * order.repeats
        )

    def session_statement(self) -> dict[str, Any]:
        """What ``session.toml`` states of a session of presses, as keywords: its kind, profile, plan and notes."""
        pressed = f"the arm pressed {self.order.contact}, no key; scale of the {self.setup.encoder} on its shaft"
        return {
            "kind": "felt",
            "profile": FileInfo(name=f"felt {self.order.contact}"),
            "plan": PlanInfo(trials=self.count, rest_s=self.order.rest_s),
            "notes": {
                "recording": pressed,
                **(self.options.permission.session_notes() if self.options.permission else {}),
            },
        }

    def check(self, profile: Profile) -> None:
        body = [encoder.name for encoder in self.config.encoders].index(self.setup.encoder)
        check_press(profile, self.config, (1 - 1e-6) * self.config.limits.travel_rad[body], body)

    def evaluate_press(self, session: Session, trial: Trial) -> FeltPress:
        """Fit the loading curve of a press, and write it to the session as CSV for ``calibrate felt``."""
        curve = fit_press_curve(trial.read(), self.setup)
        folder = session.path / FOLDER
        with translate_os_error(folder, "created"):
            folder.mkdir(parents=True, exist_ok=True)
        file = folder / f"trial_{trial.number:04d}.csv"
        write_text(file, curve.table())
        return FeltPress(trial.number, curve, file)

    def record_presses(
        self,
        session: Session,
        backend: Backend,
        profiles: Sequence[Profile],
        first: int,
        options: RecordingOptions | None = None,
    ) -> None:
        """Check each profile against the limits, write it to the session, and record presses with them as the trials
        from ``first`` on; ``options`` replace those given for the session."""
        for profile in profiles:
            self.check(profile)
        entries = [Entry(first + k, f"press-{first + k}", profile) for k, profile in enumerate(profiles)]
        for entry in entries:
            write_text(session.path / f"profile_{entry.number:04d}.toml", entry.profile.text)
        record_entries(session, backend, self.config, entries, options or self.options, first_number=first)

    def record_block(self, session: Session, backend: Backend) -> FeltSession:
        """Record three presses of the steel block in the session; return the compliance of arm and load cell with the
        text of a rig file that has it, which is not written."""
        self.record_presses(session, backend, [make_ramp(max(self.order.peaks_n))] * BLOCK_PRESSES, 1)
        found = measure_compliance([trial.read() for trial in session.trials], self.setup)
        values = {"compliance_m_per_n": found.m_per_n, "u_compliance_m_per_n": found.u_m_per_n}
        text = change_table(self.rig.text, "felt", {key: float(f"{value:.6g}") for key, value in values.items()})
        parse_rig(text, f"{self.rig.source} with the compliance found")
        return FeltSession(session, compliance=found, rig_text=text)

    def record_felt(self, session: Session, backend: Backend) -> FeltSession:
        """Record a ramp, then presses at each speed and peak of the order, shaped by the ramp's curve, in the session;
        write the loading curve of each as soon as it is recorded, and return them."""
        order = self.order
        self.record_presses(session, backend, [make_ramp(max(order.peaks_n))], 1)
        moved, force = _read_loading_curve(session, self.setup)
        slew = self.config.motor.slew_limit_n_per_s
        shaped = [
            make_constant_speed_press(moved, force, speed, peak, slew)
            for peak in order.peaks_n
            for speed in order.speeds_m_per_s
            for _ in range(order.repeats)
        ]
        backend.wait(order.rest_s)
        presses: list[FeltPress] = []

        def evaluate(trial: Trial) -> None:
            # at once: what ends the recording later takes no curve with it
            presses.append(self.evaluate_press(session, trial))
            if self.options.after_trial is not None:
                self.options.after_trial(trial)

        self.record_presses(session, backend, shaped, 2, replace(self.options, after_trial=evaluate))
        return FeltSession(session, tuple(presses))


def _read_loading_curve(session: Session, felt: FeltConfig) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return compression since rest, m, and force above the preload, N, (k,) each, both rising from zero, while the
    session's first trial, a ramp, loads; refuse a ramp that moved nothing."""
    trial = session.trials[0].read()
    read = read_press(trial, felt, lowest_share=0.0)
    force = read.force_n[read.loading] - trial.force_info.preload_n
    compression_m = read.moved_m[read.loading] - felt.compliance_m_per_n * force
    order = np.argsort(force)
    force, compression_m = force[order], np.maximum.accumulate(compression_m[order])
    above = (force > 0) & (compression_m > 0)
    if above.sum() < FEWEST_POINTS:
        raise RigInputError("felt: the ramp moved nothing; is the arm on the felt, the drive on?")
    return np.concatenate(([0.0], compression_m[above])), np.concatenate(([0.0], force[above]))
