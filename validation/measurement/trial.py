"""One trial as validation sees it: corrected force, encoder angles with uncertainty, film angles, baseline, motion.

Conventions: angles are changes since rest in rad, counter-clockwise; everything on the DAQ clock; encoder
order key, whippen, hammer whatever the order in the file; jack and repetition lever relative to the whippen.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from rig.session import TrialData
from validation.conventions import ENCODER_CHANNELS, FILM_CHANNELS, Array
from validation.errors import TrialError
from validation.measurement.force_correction import CorrectedForce, Quiet, correct_force, encoder_change, find_quiet
from validation.measurement.geometry import ActionGeometry
from validation.measurement.key_heads import KeyHeads, two_heads
from validation.measurement.mains_hum import TOO_SHORT
from validation.measurement.stroke import Motion, motion_of

# hammer height and key dip at rest are set with gauges to about 0.1 mm (rectangular, half width)
U_REST_LEVEL_M = 0.1e-3 / np.sqrt(3)


@dataclass(frozen=True)
class FilmAngles:
    """Angles tracked on the film of one trial, relative to the whippen and to rest; NaN where lost.

    ``u_rad`` is all that is known of their uncertainty, ``u_noise_rad`` the part from noise and reference.
    ``whippen_rad`` is the whippen's own, where the film shows it: it tells the film's clock from the encoder's.
    """

    time_s: Array
    change_rad: dict[str, Array]
    u_rad: dict[str, Array]
    u_time_s: float
    whippen_rad: Array | None = None
    u_noise_rad: dict[str, Array] = field(default_factory=dict)


@dataclass(frozen=True)
class MeasuredTrial:
    """A usable trial.

    ``read_motion`` makes the motion from sample times and changes of angle; it is made when asked for, since those of
    hundreds of trials would be a third of what is kept of them.
    """

    number: int
    time_s: Array
    raw_force_n: Array
    force: CorrectedForce
    quiet: Quiet
    change_rad: Array
    u_rad: Array
    resolution_rad: Array
    scale_relative_u: Array
    read_motion: Callable[[Array, Array], Motion]
    film: FilmAngles | None
    seal: str
    notes: tuple[str, ...] = ()

    @property
    def has_force(self) -> bool:
        """Whether a force was recorded; without one its arrays are NaN."""
        return bool(np.isfinite(self.force.force_n).any())

    @property
    def motion(self) -> Motion:
        """Key dip and hammer height over time."""
        return self.read_motion(self.time_s, self.change_rad)


def measure(
    data: TrialData,
    film_table: pd.DataFrame | None,
    geometry: ActionGeometry,
    *,
    u_rest_level_m: float = U_REST_LEVEL_M,
    seal: str = "",
) -> MeasuredTrial:
    """Correct the force, zero the angles and state the uncertainties of one trial.

    Parameters
    ----------
    data : rig.session.TrialData
    film_table : pandas.DataFrame or None
        Derived step ``angles``: time_s, jack_relative_rad, jack_relative_u_rad, repetition_relative_rad, …
    geometry : ActionGeometry
        Of the action under test; its rest state gives the absolute angles.
    u_rest_level_m : float
        Standard uncertainty with which hammer height and key dip at rest are known on the bench.
    seal : str
        SHA-256 of the trial, for provenance.

    Raises
    ------
    TrialError
        When a channel is missing or the trial has no usable baseline.
    """
    read = read_encoders(data)
    counts, heads = read.count, read.heads
    info = data.force_info
    time = np.asarray(data.time_s, dtype=float)
    quiet = find_quiet(time, data.force_n, counts, mains_hz=info.mains_frequency_hz, group_delay_s=info.group_delay_s)
    force = correct_force(
        time,
        data.force_n,
        quiet,
        group_delay_s=info.group_delay_s,
        preload_n=info.preload_n,
        u_preload_n=info.u_preload_n,
        u_group_delay_s=info.u_group_delay_s,
        gain_relative_u=info.u_gain_relative,
        mains_hz=info.mains_frequency_hz,
    )
    angles = read.change(quiet)
    film, notes = film_angles(film_table, data, quiet)
    if heads is not None:
        notes.append(heads.note(quiet))
    if force.hum.reason.startswith(TOO_SHORT):
        notes.append(f"hum not subtracted: {force.hum.reason}")
    return MeasuredTrial(
        data.number,
        time,
        np.asarray(data.force_n, dtype=float),
        force,
        quiet,
        angles.change_rad,
        angles.u_rad,
        read.resolution_rad,
        read.scale_relative_u,
        read.motion_reader(angles, geometry, u_rest_level_m),
        film,
        seal,
        tuple(notes),
    )


@dataclass(frozen=True)
class EncoderChange:
    """Angles since rest (n, 3), their uncertainty from sample to sample and of the zero, (3,) each, rad."""

    change_rad: Array
    u_sample_rad: Array
    u_zero_rad: Array

    @property
    def u_rad(self) -> Array:
        """Both together."""
        return np.asarray(np.hypot(self.u_sample_rad, self.u_zero_rad))


@dataclass(frozen=True)
class EncoderReading:
    """Counts (n, 3) and angles (n, 3), rad, of key, whippen and hammer; what is known of their errors, (3,) each.

    ``heads`` : the two heads of the key, where it has two
    """

    count: NDArray[np.int64]
    angle_rad: Array
    resolution_rad: Array
    u_change_rad: Array
    scale_relative_u: Array
    heads: KeyHeads | None

    def change(self, quiet: Quiet) -> EncoderChange:
        """Change since the quiet baseline."""
        change, u_sample, u_zero = encoder_change(self.angle_rad, quiet, self.resolution_rad)
        return EncoderChange(change, np.hypot(u_sample, self.u_change_rad), u_zero)

    def motion_reader(
        self, angles: EncoderChange, geometry: ActionGeometry, u_rest_level_m: float
    ) -> Callable[..., Motion]:
        """What reads motions of key and hammer from times and changed angles, with these encoders' uncertainties."""
        return partial(
            motion_of,
            geometry,
            u_sample_rad=angles.u_sample_rad,
            u_zero_rad=angles.u_zero_rad,
            u_height_zero_m=u_rest_level_m,
            u_dip_zero_m=u_rest_level_m,
            u_scale_relative=self.scale_relative_u,
        )


def read_encoders(data: TrialData) -> EncoderReading:
    """The encoders of key, whippen and hammer, in this order whatever the order in the file.

    Raises
    ------
    TrialError
        One is missing.
    """
    names = [encoder.name for encoder in data.encoders]
    missing = [name for name in ENCODER_CHANNELS if name not in names]
    if missing:
        raise TrialError(f"encoder {missing[0]!r} is missing; found {names}; key, whippen and hammer are needed")
    order = [names.index(name) for name in ENCODER_CHANNELS]
    angle = np.asarray(data.angle_rad(), dtype=float)[:, order]
    resolution = np.array([abs(data.encoders[i].rad_per_count) for i in order])
    u_change = np.array([data.encoders[i].u_change_rad for i in order])
    scale = np.array([data.encoders[i].u_turn_relative for i in order])
    heads = two_heads(data, angle[:, 0])
    if heads is not None:
        angle[:, 0], resolution[0] = heads.rotation_rad, heads.resolution_rad
        u_change[0], scale[0] = heads.u_change_rad, heads.u_turn_relative
    return EncoderReading(np.asarray(data.encoder_count)[:, order], angle, resolution, u_change, scale, heads)


def film_angles(table: pd.DataFrame | None, data: TrialData, quiet: Quiet) -> tuple[FilmAngles | None, list[str]]:
    """Angles of a track file, and notes on them.

    Raises
    ------
    TrialError
        A column is missing, or its times do not increase.
    """
    if table is None:
        return None, []
    needed = ["time_s"] + [f"{name}_relative{tail}" for name in FILM_CHANNELS for tail in ("_rad", "_u_rad")]
    missing = [name for name in needed if name not in table.columns]
    if missing:
        raise TrialError(f"derived film angles: column {missing[0]!r} is missing; track the film again")
    time = table["time_s"].to_numpy(dtype=float)
    if not np.all(np.diff(time) > 0):
        raise TrialError("derived film angles: time_s must increase from row to row; track the film again")
    change = {name: table[f"{name}_relative_rad"].to_numpy(dtype=float) for name in FILM_CHANNELS}
    u = {name: table[_u_column(table, name)].to_numpy(dtype=float) for name in FILM_CHANNELS}
    noise = {name: table[f"{name}_relative_u_rad"].to_numpy(dtype=float) for name in FILM_CHANNELS}
    whippen = table["whippen_rad"].to_numpy(dtype=float) if "whippen_rad" in table else None
    notes = []
    if time[0] > quiet.end_s:
        notes.append(
            f"film starts at {time[0]:.4f} s, after the quiet interval ended at {quiet.end_s:.4f} s: "
            "its zero is not at rest"
        )
    for name in FILM_CHANNELS:
        lost = int((~np.isfinite(change[name])).sum())
        if lost:
            notes.append(f"film: {name} lost in {lost} of {time.size} frames")
    u_time = 0.0 if data.camera is None else data.camera.u_time_s
    return FilmAngles(time, change, u, u_time, whippen, noise), notes


def _u_column(table: pd.DataFrame, name: str) -> str:
    """Column of the uncertainty: the total one, or that of noise and reference alone where there is no other.

    Only tracks of films without a stated budget of camera, shutter and codec lack the total; the partial one is then
    all that is known of them, and smaller than the truth.
    """
    total = f"{name}_relative_u_total_rad"
    return total if total in table else f"{name}_relative_u_rad"
