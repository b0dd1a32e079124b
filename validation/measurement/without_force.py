"""A trial without a force: encoder angles with uncertainty, for a comparison in which the measured key drives.

Conventions: as in `validation.measurement.trial`; all of the force is NaN, the preload none.
"""

from __future__ import annotations

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from rig.session import TrialData
from validation.conventions import Array
from validation.errors import TrialError
from validation.measurement.force_correction import (
    FIRST_BASELINE_S,
    MARGIN_S,
    MINIMUM_QUIET_S,
    MOVED_COUNTS,
    MOVED_SIGMA,
    ONSET_SAMPLES,
    CorrectedForce,
    ForceChannel,
    Quiet,
    first_run,
)
from validation.measurement.geometry import ActionGeometry
from validation.measurement.mains_hum import HumFit
from validation.measurement.trial import MeasuredTrial, film_angles, read_encoders

NONE = "no force was recorded"


def measure_without_force(
    data: TrialData, film_table: pd.DataFrame | None, geometry: ActionGeometry, *, u_rest_level_m: float, seal: str = ""
) -> MeasuredTrial:
    """Zero the angles and state their uncertainties; see `validation.measurement.trial.measure`.

    Raises
    ------
    TrialError
        An encoder is missing, or the action does not rest before the blow.
    """
    read = read_encoders(data)
    time = np.asarray(data.time_s, dtype=float)
    quiet = quiet_of_motion(time, read.count)
    angles = read.change(quiet)
    film, notes = film_angles(film_table, data, quiet)
    nothing = np.full(time.size, np.nan)
    hum = HumFit(0.0, 0.0, 0.0, False, (), (), 0.0, 0.0, False, NONE, np.zeros((0, 0)))
    return MeasuredTrial(
        data.number,
        time,
        nothing,
        CorrectedForce(time, nothing, nothing, hum, float("nan"), ForceChannel()),
        quiet,
        angles.change_rad,
        angles.u_rad,
        read.resolution_rad,
        read.scale_relative_u,
        read.motion_reader(angles, geometry, u_rest_level_m),
        film,
        seal,
        (*notes, NONE),
    )


def quiet_of_motion(time_s: Array, encoder_count: NDArray[np.int64]) -> Quiet:
    """The baseline before any encoder moves.

    Raises
    ------
    TrialError
        None moves, or one does too early.
    """
    step = float(np.median(np.diff(time_s)))
    first = max(round(FIRST_BASELINE_S / step), 8)
    start = encoder_count[:first]
    away = np.abs(encoder_count - np.median(start, axis=0)) > np.maximum(MOVED_COUNTS, MOVED_SIGMA * start.std(axis=0))
    moved = first_run(away.any(axis=1), ONSET_SAMPLES)
    if moved is None:
        raise TrialError("no encoder moves by more than three counts; was the blow played?")
    stop = moved - round(MARGIN_S / step)
    if stop < round(MINIMUM_QUIET_S / step):
        raise TrialError(
            f"encoders rest for {1e3 * max(stop, 0) * step:.0f} ms only; at least {1e3 * MINIMUM_QUIET_S:.0f} ms are "
            "needed before the blow; record a longer rest"
        )
    return Quiet(stop, float(time_s[0]), float(time_s[stop - 1]), float(time_s[moved]))
