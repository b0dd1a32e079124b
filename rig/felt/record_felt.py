"""Recording a felt: a slow ramp first, then each speed with each peak force, shaped from what the ramp found.

Everything a blow has is there too: permission, watchdog, interlocks, journal, sealed trials; the limits of travel and
force are the felt's, and what is pressed how often, how fast and how hard is checked before anything moves. The curves
go to ``derived/felt/`` of the session.

A torque motor commands force, not motion: a ramp of force slows down in a felt that hardens, and a loop at a changing
speed is no constant share of the felt's curve (eq. 2.7). From the ramp's curve of force over displacement follows the
force that moves the arm at one speed, with smooth beginning and end and a rest at the peak, during which nothing rings.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Unpack

import numpy as np
from numpy.typing import NDArray

from rig.arrays import as_numbers
from rig.backend import Backend
from rig.calibration import changed
from rig.configuration.profile import MotorCommand, Profile, motor_command, parse_profile
from rig.configuration.rig_file import FeltConfig, Rig, RigConfig, load_rig, parse_rig
from rig.configuration.toml_file import dump_toml
from rig.errors import RigInputError
from rig.felt.press_curve import Compliance, PressCurve, compliance, press_curve, readings
from rig.recording.options import RecordingKeywords, RecordingOptions
from rig.recording.sealing import new_session
from rig.recording.trial_plan import Entry
from rig.recording.trial_run import record_entries
from rig.safety.dry_run import PredictedBlow, dry_run
from rig.safety.permission import require_permission
from rig.session.folder import Session, Trial
from rig.session.info import FileInfo, PlanInfo
from rig.storage.atomic_write import refused, write_text

BLOCK = "block"
"""What is pressed to measure the compliance of arm and cell: a block of steel."""
SLOWEST_M_PER_S, FASTEST_M_PER_S = 1e-4, 0.2


@dataclass(frozen=True)
class FeltOrder:
    """One loading experiment.

    Attributes
    ----------
    contact : name of the felt, for example ``contact02``, or ``block``
    speeds_m_per_s, peaks_n : each speed is played with each peak force
    repeats : presses of each kind
    rest_s : between two presses, for the felt to recover
    """

    contact: str
    speeds_m_per_s: Sequence[float] = (0.002, 0.008, 0.02)
    peaks_n: Sequence[float] = (15.0, 30.0)
    repeats: int = 1
    rest_s: float = 2.0

    def __post_init__(self) -> None:
        """Take speeds and forces as they are given."""
        for name in ("speeds_m_per_s", "peaks_n"):
            object.__setattr__(self, name, tuple(as_numbers(getattr(self, name), f"felt: {name}", 1).tolist()))


def checked(order: FeltOrder, config: RigConfig, source: str) -> FeltConfig:
    """Return the rig file's ``[felt]`` after a check of the order against it.

    Raises
    ------
    RigInputError
        No ``[felt]``, or a speed, force or number out of range.
    """
    felt = config.felt
    if felt is None:
        raise RigInputError(
            f"{source}: has no table [felt]; add radius_m and compliance_m_per_n of the arm as in the built-in rig "
            "`virtual`"
        )
    if not order.speeds_m_per_s or not order.peaks_n:
        raise RigInputError("felt: allowed from one speed and one peak force on")
    for speed in order.speeds_m_per_s:
        if not SLOWEST_M_PER_S <= speed <= FASTEST_M_PER_S:
            raise RigInputError(f"felt: speed {speed:g} m/s, allowed {SLOWEST_M_PER_S:g} to {FASTEST_M_PER_S:g} m/s")
    for peak in order.peaks_n:
        if not 1.0 <= peak <= felt.force_limit_n:
            raise RigInputError(
                f"felt: peak force {peak:g} N, allowed 1 to {felt.force_limit_n:g} N (felt.force_limit_n)"
            )
    if not 1 <= order.repeats <= 100 or not 0 <= order.rest_s <= 3600:
        raise RigInputError(f"felt: {order.repeats} repeats, rest {order.rest_s:g} s; allowed 1 to 100, 0 to 3600 s")
    return felt


def guarded(config: RigConfig, felt: FeltConfig, peak_n: float) -> RigConfig:
    """Return the settings of a press: no camera, the limits of force and travel those of a felt."""
    limits, body = config.limits, [encoder.name for encoder in config.encoders].index(felt.encoder)
    travel, speed = list(limits.travel_rad), list(limits.speed_rad_per_s)
    travel[body] = (felt.depth_limit_m + felt.compliance_m_per_n * felt.force_limit_n) / felt.radius_m
    speed[body] = 5 * FASTEST_M_PER_S / felt.radius_m
    narrowed = limits.model_copy(
        update={
            "force_max_n": min(limits.force_max_n, 1.2 * peak_n + 1.0, 1.1 * felt.force_limit_n),
            "travel_rad": tuple(travel),
            "speed_rad_per_s": tuple(speed),
        }
    )
    return config.model_copy(update={"camera": None, "limits": narrowed})


RAMP_S = 1.5
"""Of the first press, each way."""
HOLD_S = 0.08
EASE = 0.12
"""Share of the way over which the speed is reached, and left."""
POINTS = 60
SLEW_SHARE = 0.9
Array = NDArray[np.float64]


def ramp(peak_n: float) -> Profile:
    """Return the slow press: a smooth ramp to the peak, a rest, and back."""
    phase = np.linspace(0.0, 1.0, POINTS)
    rise = _eased(phase)
    return _there_and_back("ramp", RAMP_S * phase, peak_n * rise)


def at_speed(moved_m: Array, force_n: Array, speed_m_per_s: float, peak_n: float, slew_n_per_s: float) -> Profile:
    """Return the press that moves the felt's surface at one speed.

    Parameters
    ----------
    moved_m, force_n : (k,) way since the arm's rest and force above its preload, both rising from 0, as the ramp found
    speed_m_per_s, peak_n : wanted
    slew_n_per_s : fastest change of force that the rig file allows

    Raises
    ------
    RigInputError
        The felt is too hard for this speed; the message says how fast it may be.
    """
    way = float(np.interp(peak_n, force_n, moved_m))
    phase = np.linspace(0.0, 1.0, POINTS)
    moved = way * _eased(phase)
    duration = way * (1.0 + EASE) / speed_m_per_s
    force = np.interp(moved, moved_m, force_n)
    force *= peak_n / force[-1]
    steepest = float(np.max(np.diff(force))) * (POINTS - 1) / duration
    if steepest > SLEW_SHARE * slew_n_per_s:
        allowed = SLEW_SHARE * slew_n_per_s
        raise RigInputError(
            f"felt: {speed_m_per_s:g} m/s to {peak_n:g} N needs {steepest:.4g} N/s, allowed {allowed:g} N/s "
            f"(motor.slew_limit_n_per_s); press at {speed_m_per_s * allowed / steepest:.2g} m/s at most, or less hard"
        )
    return _there_and_back(f"{1e3 * speed_m_per_s:g} mm/s to {peak_n:g} N", duration * phase, force)


def checked_command(profile: Profile, config: RigConfig, deepest_rad: float, body: int) -> MotorCommand:
    """Return the motor command of a press after a dry run without inertia: the force follows the command.

    Raises
    ------
    RigInputError
        Outside the limits of motor or rig file; nothing has moved.
    """
    rate = config.device.sample_rate_hz
    force = profile.sample(rate)
    angle = np.zeros((force.size, 3))
    angle[:, body] = deepest_rad * force / max(float(force.max()), 1e-9)
    speed = np.diff(angle, axis=0, append=angle[-1:]) * rate
    predicted = PredictedBlow(np.arange(force.size) / rate, force, angle, speed, "a felt without inertia")
    dry_run(profile, config, lambda _: predicted)
    return motor_command(profile, config)


def _eased(phase: Array) -> Array:
    """Way over time, both from 0 to 1: constant speed between a smooth beginning and a smooth end."""
    fine = np.linspace(0.0, 1.0, 2001)
    at = EASE / (1.0 + EASE)
    speed = np.clip(np.minimum(fine, 1.0 - fine) / at, 0.0, 1.0)
    speed = speed * speed * (3.0 - 2.0 * speed)
    way = np.concatenate(([0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]))))
    return np.interp(phase, fine, way / way[-1])


def _there_and_back(name: str, time_s: Array, force_n: Array) -> Profile:
    at = np.concatenate((time_s, time_s[-1] + HOLD_S + time_s))
    force = np.concatenate((force_n, force_n[::-1]))
    force[0] = force[-1] = 0.0
    points = [{"time_s": float(f"{t:.7g}"), "force_n": float(f"{f:.7g}")} for t, f in zip(at, force, strict=True)]
    table = {
        "name": name,
        "description": "a press and its release, made by `pianorig record --felt`",
        "interpolation": "pchip",
        "points": points,
    }
    return parse_profile(dump_toml(table), name)


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
    with new_session(out, options, rig) as (backend, create):
        require_permission(rig, backend.capabilities, options.permission, dry_run=True)
        session = create({}, **press.stated())
        return press.block(session, backend) if order.contact == BLOCK else press.felt(session, backend)


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

    def stated(self) -> dict[str, Any]:
        """What a session of presses states of itself."""
        pressed = f"the arm pressed {self.order.contact}, no key; scale of the {self.setup.encoder} on its shaft"
        return {
            "kind": "felt",
            "profile": FileInfo(name=f"felt {self.order.contact}"),
            "plan": PlanInfo(trials=self.count, rest_s=self.order.rest_s),
            "notes": {"recording": pressed, **(self.options.permission.noted() if self.options.permission else {})},
        }

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
