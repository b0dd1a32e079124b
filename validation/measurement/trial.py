"""One trial as validation sees it: corrected force, encoder angles with uncertainty, film angles, baseline, motion.

Conventions: angles are changes since rest in rad, counter-clockwise; everything on the DAQ clock; encoder
order key, whippen, hammer whatever the order in the file; jack and repetition lever relative to the whippen.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from functools import partial

import numpy as np
import pandas as pd

import model
from rig.session import TrialData
from rig.session.force_correction import TOO_SHORT, CorrectedForce, ForceChannel, HumFit, Quiet, quiet_of_motion
from rig.session.info import KEY_OPPOSITE
from validation.conventions import ENCODER_CHANNELS, FILM_CHANNELS, Array
from validation.errors import TrialError
from validation.measurement.geometry import ActionGeometry, Motion, motion_of
from validation.measurement.position_sensors import PositionSensors
from validation.measurement.sample_fingerprints import sample_fingerprints


@dataclass(frozen=True)
class KeyHeads:
    rotation_rad: Array  # (n,) rotation since the first sample
    lift_m: Array  # (n,) height of the pivot above that of the first sample
    u_lift_m: float  # standard uncertainty of one value of the lift, without that of the radius
    u_radius_relative: float  # of the lift, from the scale's radius
    # resolution_rad, u_change_rad, u_turn_relative: of the rotation, as of a single encoder
    resolution_rad: float
    u_change_rad: float
    u_turn_relative: float

    def note(self, quiet: Quiet) -> str:
        """One sentence on the largest lift of the key's pivot and its uncertainty; ``quiet`` tells the samples at
        rest."""
        rest = float(np.mean(self.lift_m[: max(quiet.stop, 1)]))
        largest = float(np.max(self.lift_m) - rest)
        u = float(np.hypot(self.u_lift_m, largest * self.u_radius_relative))
        said = (
            f"lifts by up to {1e3 * largest:.3f} mm (standard uncertainty {1e3 * u:.3f} mm)"
            if largest > 3 * u
            else "does not lift"
        )
        return f"key read by two heads: rotation without lift and eccentricity; its pivot {said}"


def join_key_heads(data: TrialData, key_rad: Array) -> KeyHeads | None:
    """Rotation and lift of the key from both heads of its encoder; ``key_rad`` (n,): angle that the first head reads,
    the second one's is a channel of ``data``; None where the trial has one head.

    Head one reads the rotation plus lift over radius, head two minus; the error of a scale off its centre changes its
    sign as well. The shift of the pivot in its bushing moves the centre, too, and goes with the lift.
    """
    names = [channel.name for channel in data.channels]
    if KEY_OPPOSITE not in names or data.channel_values is None:
        return None
    channel = data.channels[names.index(KEY_OPPOSITE)]
    other = np.asarray(data.channel_values[:, names.index(KEY_OPPOSITE)], dtype=float)
    key = next(encoder for encoder in data.encoders if encoder.name == "key")
    radius, u_radius = (float(found) for found in re.findall(r"([\d.eE+-]+) m\b", channel.sensor)[:2])
    # the mean of both is free of the eccentricity that ``arc_gain`` corrects, and head two comes without it
    first, second = (key_rad - key_rad[0]) / key.arc_gain, other - other[0]
    step = abs(key.rad_per_count) / np.sqrt(12.0)
    head = np.hypot(step, np.sqrt(2.0) * key.u_interpolation_rad)
    return KeyHeads(
        rotation_rad=0.5 * (first + second),
        lift_m=0.5 * (first - second) * radius,
        # the shift of the pivot is no lift of the key, but cannot be told from one; nor can the scale's centre
        u_lift_m=float(radius * np.sqrt(0.5 * head**2 + key.u_pivot_shift_rad**2)),
        u_radius_relative=u_radius / radius,
        resolution_rad=abs(key.rad_per_count) / np.sqrt(2.0),
        u_change_rad=float(key.u_interpolation_rad),
        u_turn_relative=key.u_scale_relative,
    )


# hammer height and key dip at rest are set with gauges to about 0.1 mm (rectangular, half width)
U_REST_LEVEL_M = 0.1e-3 / np.sqrt(3)


NONE = "no force was recorded"


def make_absent_force(time_s: Array, quiet: Quiet) -> CorrectedForce:
    """The force of a trial without one: NaN at its sample times, no preload."""
    lost = np.full(time_s.size, np.nan)
    hum = HumFit(0.0, 0.0, 0.0, False, (), (), 0.0, 0.0, False, NONE, np.zeros((0, 0)))
    return CorrectedForce(time_s, lost, lost, quiet, hum, float("nan"), ForceChannel())


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


@dataclass(frozen=True, eq=False)
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
    samples: tuple[str, ...] = ()
    sensors: PositionSensors | None = None  # of key and hammer, in place of encoders
    driven_by_key: bool = False  # whether the measured key drives the model, not the force

    @property
    def channels(self) -> tuple[str, ...]:
        """What is compared of the encoders or position sensors: not what drives, not what was not measured."""
        measured = [name for i, name in enumerate(ENCODER_CHANNELS) if np.isfinite(self.change_rad[:, i]).any()]
        return tuple(name for name in measured if not (self.driven_by_key and name == "key"))

    @property
    def has_force(self) -> bool:
        """Whether a force was recorded; without one its arrays are NaN."""
        return bool(np.isfinite(self.force.force_n).any())

    @property
    def motion(self) -> Motion:
        """Key dip and hammer height over time."""
        return self.read_motion(self.time_s, self.change_rad)


def _force_doubt(force: CorrectedForce) -> list[str]:
    """One note, in a list, on why the force is implausible as a blow on a key; empty if it is not, or where it cannot
    be simulated at all, which is refused later."""
    known = np.isfinite(force.force_n)
    try:
        doubt = model.blow_implausibility(force.time_s[known], force.force_n[known], "force")
    except model.InputError:
        return []
    return [doubt] if doubt else []


def measure(
    data: TrialData,
    film_table: pd.DataFrame | None,
    geometry: ActionGeometry,
    *,
    u_rest_level_m: float = U_REST_LEVEL_M,
    seal: str = "",
    by_motion: bool = False,
) -> MeasuredTrial:
    """Measured trial: force corrected, angles since rest with their uncertainties, film angles from ``film_table``
    (None without film), notes. Raises a trial error where an encoder is missing. ``by_motion``: the key drives the
    model, not the force.

    Without a force all of it is NaN, the preload none: the measured key then drives.

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
    by_motion : bool
        The measured key drives the model although a force was recorded.
    """
    names = [encoder.name for encoder in data.encoders]
    missing = [name for name in ENCODER_CHANNELS if name not in names]
    if missing:
        raise TrialError(f"encoder {missing[0]!r} is missing; found {names}; key, whippen and hammer are needed")
    order = [names.index(name) for name in ENCODER_CHANNELS]
    angle, counts = np.asarray(data.angle_rad, dtype=float)[:, order], np.asarray(data.encoder_count)[:, order]
    resolution = np.array([abs(data.encoders[i].rad_per_count) for i in order])
    u_change = np.array([data.encoders[i].u_change_rad for i in order])
    scale = np.array([data.encoders[i].u_turn_relative for i in order])
    heads = join_key_heads(data, angle[:, 0])
    if heads is not None:
        angle[:, 0], resolution[0] = heads.rotation_rad, heads.resolution_rad
        u_change[0], scale[0] = heads.u_change_rad, heads.u_turn_relative
    time = np.asarray(data.time_s, dtype=float)
    notes: list[str] = []
    if data.has_force:
        force = data.corrected_force()
        quiet = force.quiet
        raw = np.asarray(data.raw_force_n, dtype=float)
        notes += [heads.note(quiet)] if heads is not None else []
        if force.hum.reason.startswith(TOO_SHORT):
            notes.append(f"hum not subtracted: {force.hum.reason}")
        notes += _force_doubt(force)
    else:
        quiet, raw = quiet_of_motion(time, counts), np.full(time.size, np.nan)
        force = make_absent_force(time, quiet)
        notes.append(NONE)
    change, u_sample, u_zero = encoder_change(angle, quiet, resolution)
    u_sample = np.hypot(u_sample, u_change)
    film, of_film = film_angles(film_table, data, quiet)
    read_motion = partial(
        motion_of,
        geometry,
        u_sample_rad=u_sample,
        u_zero_rad=u_zero,
        u_height_zero_m=u_rest_level_m,
        u_dip_zero_m=u_rest_level_m,
        u_scale_relative=scale,
    )
    return MeasuredTrial(
        number=data.number,
        time_s=time,
        raw_force_n=raw,
        force=force,
        quiet=quiet,
        change_rad=change,
        u_rad=np.asarray(np.hypot(u_sample, u_zero)),
        resolution_rad=resolution,
        scale_relative_u=scale,
        read_motion=read_motion,
        film=film,
        seal=seal,
        samples=sample_fingerprints(data),
        notes=(*of_film, *notes),
        driven_by_key=by_motion or not data.has_force,
    )


def encoder_change(angle_rad: Array, quiet: Quiet, resolution_rad: Array) -> tuple[Array, Array, Array]:
    """Angles (n, m) less their means over the rest of ``quiet``, rad; standard uncertainty (m,) of a sample against its
    neighbours, and that of the zero, common to all samples, (m,); ``resolution_rad`` (m,): angle of one count.

    Zero is the mean over the quiet interval.  The uncertainty holds the quantisation of the sample, the
    quantisation left in the zero (an encoder that stands still repeats the same rounding error) and the
    jitter seen while nothing moves.
    """
    angle = np.asarray(angle_rad, dtype=float)
    still = angle[: quiet.stop]
    jitter = still.std(axis=0, ddof=1)
    quantisation = np.asarray(resolution_rad, dtype=float) / np.sqrt(12.0)
    return angle - still.mean(axis=0), np.hypot(quantisation, jitter), quantisation


def film_angles(table: pd.DataFrame | None, data: TrialData, quiet: Quiet) -> tuple[FilmAngles | None, list[str]]:
    """Film angles of a trial from its derived ``table`` (None without one), and notes on lost frames and on a zero that
    is not at rest. Raises a trial error where a column is missing or times do not increase."""
    if table is None:
        return None, []
    needed = ["time_s"] + [f"{name}_relative{tail}" for name in FILM_CHANNELS for tail in ("_rad", "_u_rad")]
    missing = [name for name in needed if name not in table.columns]
    if missing:
        raise TrialError(f"derived film angles: column {missing[0]!r} is missing; track the film again")
    time = table["time_s"].to_numpy(dtype=float)
    if time.size < 2 or not np.all(np.diff(time) > 0):
        raise TrialError("derived film angles: time_s must increase over two rows or more; track the film again")
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
    """Name of the column of ``table`` with the standard uncertainty of the body ``name`` on film: the total one, or,
    where there is none, that of noise and reference alone, which is too small.

    Only tracks of films without a stated budget of camera, shutter and codec lack the total; the partial one is then
    all that is known of them, and smaller than the truth.
    """
    total = f"{name}_relative_u_total_rad"
    return total if total in table else f"{name}_relative_u_rad"


MOST_NAMED = 4
"""Trials that a sentence names."""


def trials_in_words(numbers: Iterable[object], most: int | None = None) -> str:
    """Numbers of trials as a sentence names them: ``trial 3``, ``trials 3, 5``; of more than ``most`` how many more."""
    named = [str(number) for number in numbers]
    more = f" and {len(named) - most} more" if most is not None and len(named) > most else ""
    return f"trial{'' if len(named) == 1 else 's'} {', '.join(named[:most])}{more}"
