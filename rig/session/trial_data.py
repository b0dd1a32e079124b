"""One trial in memory: the arrays on the DAQ clock and what is needed to interpret them.

Conventions: force positive downwards on the key, calibrated but not corrected for offset, channel delay or mains hum;
encoder counts as integers exactly as the counters gave them; angles counter-clockwise, zero at the first sample.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rig.arrays import ArrayRecord, as_numbers
from rig.configuration.rig_file import BODIES
from rig.errors import RigInputError
from rig.session.info import NO_FORCE, ChannelInfo, EncoderInfo, ForceInfo
from rig.tabular import Tabular

if TYPE_CHECKING:
    import pandas as pd

    from rig.session.force_correction import CorrectedForce
    from rig.session.ruler import Position


def absent_bodies(names: Iterable[str]) -> tuple[str, ...]:
    present = set(names)
    return tuple(body for body in BODIES if body not in present)


@dataclass(frozen=True)
class CameraInfo:
    """Frame clock of the camera on the DAQ's time axis.

    ``first_frame_time_s`` is the middle of the first exposure (time zero: AI start trigger); frame k follows
    ``k / frame_rate_hz`` later. ``u_time_s`` is the standard uncertainty of that tie.
    """

    frame_rate_hz: float
    first_frame_time_s: float
    exposure_s: float
    n_frames: int
    u_time_s: float

    @property
    def frame_time_s(self) -> NDArray[np.float64]:
        """Middle of each exposure, s, shape (n_frames,)."""
        return self.first_frame_time_s + np.arange(self.n_frames) / self.frame_rate_hz


@dataclass(frozen=True, eq=False)
class TrialData(Tabular, ArrayRecord):
    """One recorded trial; ``data["hammer"]`` is one angle.

    Attributes
    ----------
    number : int
        Trial number, from 1.
    status : str
        ``complete``, ``not at rest``, ``interrupted``, ``fault`` (bench or disk), ``defect`` (an error in a program) or
        ``incomplete`` (recovered from the journal).
    reason : str
        Why the status is not ``complete``; empty otherwise.
    time_s : ndarray, shape (n,)
        Sample times since the AI start trigger, s.
    raw_force_n : ndarray, shape (n,)
        Calibrated force, N, not corrected for offset, delay or hum; NaN where none was recorded. The force as it
        acted: `corrected_force`, or ``force_n`` at the sample times.
    force_raw : ndarray, shape (n,)
        Electrical reading of the force channel, in ``force_info.electrical_unit``.
    motor_command_v : ndarray, shape (n,)
        Volts held from each sample to the next, V.
    encoder_count : ndarray of int64, shape (n, encoders)
        Counts of key, whippen and hammer since arming; an imported trial may lack some of them.
    condition : str
        Condition of the trial plan; empty without one.
    plan_entry : int
        Number of the plan's entry that was played; 0 without a plan.
    channels : tuple of ChannelInfo
        Further channels of the rig file, as many as there are.
    channel_values : ndarray, shape (n, channels), or None
        Their values, each in its unit; None without such channels.
    provenance : mapping of str
        Operator, action, rig, devices with serial numbers, calibration dates, software; empty for older files.
    """

    number: int
    status: str
    started_utc: str
    simulated: bool
    sample_rate_hz: float
    time_s: NDArray[np.float64]
    raw_force_n: NDArray[np.float64]
    force_raw: NDArray[np.float64]
    motor_command_v: NDArray[np.float64]
    encoder_count: NDArray[np.int64]
    encoders: tuple[EncoderInfo, ...]
    force_info: ForceInfo
    camera: CameraInfo | None = None
    reason: str = ""
    blow_start_s: float = 0.0
    condition: str = ""
    plan_entry: int = 0
    sha256: str = ""
    channels: tuple[ChannelInfo, ...] = ()
    channel_values: NDArray[np.float64] | None = None
    provenance: Mapping[str, str] = field(default_factory=dict)

    @property
    def has_force(self) -> bool:
        """Whether a force was recorded; without one its arrays are NaN and the file has none."""
        return self.force_info != NO_FORCE

    def corrected_force(self) -> CorrectedForce:
        """Force on the key as it acted, N, positive downwards, with uncertainty: offset and mains hum taken off,
        preload added, times shifted back by the channel's delay. RigInputError without a force or quiet baseline.

        It is what ``validate`` drives the model with, and ``model.simulate(action, trial)``.

        Returns
        -------
        CorrectedForce
            ``time_s``, ``force_n`` and ``u_force_n`` (n,); also ``to_frame()``, ``plot()`` and ``save()``.

        Raises
        ------
        RigInputError
            No force was recorded, or there is no quiet baseline before the blow.

        Examples
        --------
        >>> import rig
        >>> trial = rig.open_session("sessions/example_forte").trial(1).read()
        >>> force = trial.corrected_force()
        >>> print(f"{force.force_n.max():.1f} N at {force.time_s[force.force_n.argmax()]:.3f} s")
        33.0 N at 0.500 s
        """
        # start-up: scipy.optimize costs 0.2 s, reading a trial does not need it
        from rig.session.force_correction import correct_force, find_quiet

        if not self.has_force:
            raise RigInputError(f"trial {self.number}: no force was recorded")
        if not self.n_valid:
            raise RigInputError(f"trial {self.number}: has no samples")
        info, hz = self.force_info, self.force_info.mains_frequency_hz
        quiet = find_quiet(
            self.time_s, self.raw_force_n, self.encoder_count, mains_hz=hz, group_delay_s=info.group_delay_s
        )
        return correct_force(
            self.time_s,
            self.raw_force_n,
            quiet,
            group_delay_s=info.group_delay_s,
            u_group_delay_s=info.u_group_delay_s,
            preload_n=info.preload_n,
            u_preload_n=info.u_preload_n,
            gain_relative_u=info.u_gain_relative,
            mains_hz=hz,
        )

    @property
    def force_n(self) -> NDArray[np.float64]:
        """Corrected force at the sample times, N, shape (n,); the last value is held for the group delay."""
        force = self.corrected_force()
        return np.interp(self.time_s, force.time_s, force.force_n)

    @property
    def peak_force_n(self) -> float:
        """Largest corrected force, N; NaN where none was recorded, or where it cannot be corrected."""
        try:
            return float(self.corrected_force().force_n.max())
        except RigInputError:
            return float("nan")

    @property
    def duration_s(self) -> float:
        """Samples over their rate, s."""
        return self.n_valid / self.sample_rate_hz

    def __repr__(self) -> str:
        has = [*(["force"] if self.has_force else []), *(encoder.name for encoder in self.encoders)]
        names = ", ".join([*has, *(channel.name for channel in self.channels)])
        return (
            f"TrialData({self.number}, {self.status}: {self.duration_s:.2f} s at {self.sample_rate_hz:g} Hz; {names})"
        )

    @property
    def position_names(self) -> tuple[str, ...]:
        """Channels that are position sensors."""
        return tuple(channel.name for channel in self.channels if channel.ruler is not None)

    def position(self, name: str, zero: float = 0.0) -> Position:
        """Displacement, m, that the readings of position sensor ``name`` mean by its ruler, at times earlier by the
        sensor's delay; ``zero``: drift, in the reading's unit, that is subtracted first. RigInputError for another
        name."""
        from rig.session.ruler import position_of  # start-up: scipy.interpolate costs 0.2 s, most trials have no ruler

        for k, one in enumerate(self.channels):
            if one.name == name and one.ruler is not None and self.channel_values is not None:
                reading, felt_s = self.channel_values[:, k] - zero, self.time_s - one.group_delay_s
                return position_of(name, one.ruler, felt_s, reading, one.u_noise)
        there = self.position_names or "none"
        raise RigInputError(f"trial {self.number}: no position sensor {name!r}; found {there}")

    @property
    def absent(self) -> tuple[str, ...]:
        """Bodies whose encoder was not recorded, in the usual order."""
        return absent_bodies(encoder.name for encoder in self.encoders)

    @property
    def n_valid(self) -> int:
        """Number of samples, all of them valid and without a gap."""
        return int(self.time_s.shape[0])

    def columns(self) -> dict[str, NDArray[Any]]:
        """All columns by name, (n,) each: ``time_s``, forces where recorded (corrected, NaN where that fails; raw;
        electrical), ``motor_command_v``, ``<body>_count`` and ``<body>_rad`` of each encoder, further channels."""
        columns: dict[str, NDArray[Any]] = {"time_s": self.time_s}
        if self.has_force:
            columns |= {"force_n": self._force_or_nan(), "raw_force_n": self.raw_force_n, "force_raw": self.force_raw}
        columns["motor_command_v"] = self.motor_command_v
        for index, encoder in enumerate(self.encoders):
            columns[f"{encoder.name}_count"] = self.encoder_count[:, index]
            columns[f"{encoder.name}_rad"] = self.angle_rad[:, index]
        if self.channel_values is not None:
            columns |= {channel.name: self.channel_values[:, k] for k, channel in enumerate(self.channels)}
        return columns

    def _force_or_nan(self) -> NDArray[np.float64]:
        """Corrected force at the sample times, NaN of a trial whose force cannot be corrected."""
        try:
            return self.force_n
        except RigInputError:
            return np.full(self.n_valid, np.nan)

    def to_frame(self) -> pd.DataFrame:
        """Return the columns as a pandas table; ``attrs["units"]`` has the unit of each."""
        frame = super().to_frame()
        frame.attrs["units"] |= {"force_raw": self.force_info.electrical_unit} if self.has_force else {}
        frame.attrs["units"] |= {channel.name: channel.unit for channel in self.channels}
        return frame

    @property
    def angle_rad(self) -> NDArray[np.float64]:
        """Encoder angles, rad, counter-clockwise, shape (n, encoders), zero at the first sample."""
        return self.convert_counts()

    def convert_counts(self, zero: ArrayLike | None = None) -> NDArray[np.float64]:
        """Return the encoder angles (n, encoders), rad, zero at the counts ``zero`` (1, encoders), else the first."""
        per_count = np.array([encoder.rad_per_count for encoder in self.encoders])
        at = as_numbers(self.encoder_count[:1] if zero is None else zero, "counts at zero")
        if at.shape not in ((), (0, len(per_count)), (len(per_count),), (1, len(per_count))):
            raise RigInputError(f"counts at zero: found shape {at.shape}, allowed (1, {len(per_count)})")
        return (self.encoder_count - at) * per_count + 0.0  # a zero has no sign
