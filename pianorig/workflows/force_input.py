"""The force that drives a simulation: a CSV table, or a recorded trial with its force as ``validate`` corrects it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import model
from model.arrays import as_numbers
from pianorig.errors import CommandInputError


@dataclass(frozen=True, eq=False)
class DrivingForce:
    """A force over time, and the load under which the action rests before it.

    Attributes
    ----------
    time_s, force_n : (k,) as `model.simulate` takes them
    preload_n : force of the resting motor arm, N; 0 for a table
    """

    time_s: NDArray[np.float64]
    force_n: NDArray[np.float64]
    preload_n: float = 0.0

    def at(self, time_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """The force (m,) at times (m,), linear between those of the table."""
        return np.interp(as_numbers(time_s, "times", 1), self.time_s, self.force_n)

    def rest(self, action: model.Action, scene: model.SceneChoice) -> model.RestState | None:
        """Where the blow starts: at rest under the preload; None, the usual rest state, where there is none."""
        if not self.preload_n:
            return None
        return model.rest_state(action, force_n=self.preload_n, scene=model.build_scene(action, scene))


def read_driving_force(path: Path, column: str = "force_n") -> DrivingForce:
    """Read a CSV table, or a sealed trial (``.h5``).

    The force of a trial is corrected as in a comparison: offset, mains hum and group delay are taken off, the preload
    of the arm stays.

    Raises
    ------
    CommandInputError : a trial cannot drive this scene, or its force cannot be corrected
    model.InputError : a table that cannot be used
    rig.RigInputError : not a trial, or altered since it was sealed
    """
    if path.suffix != ".h5":
        return DrivingForce(*model.read_force_table(path, column))
    if column != "force_n":
        raise CommandInputError(f"{path}: a trial records a force, this scene is driven by {column}; give a CSV table")
    # start-up: pandas and h5py cost 0.4 s that a table does not need
    from rig.session.sealed_trial import read_trial
    from validation.errors import TrialError
    from validation.measurement.force_correction import correct_force, find_quiet

    data = read_trial(path)
    info = data.force_info
    if not data.has_force:
        raise CommandInputError(f"{path}: no force was recorded, positions only; give a trial with a force or a table")
    try:
        if not data.n_valid:
            raise TrialError("has no samples")
        quiet = find_quiet(
            data.time_s, data.force_n, data.encoder_count,
            mains_hz=info.mains_frequency_hz, group_delay_s=info.group_delay_s,
        )  # fmt: skip
        force = correct_force(
            data.time_s, data.force_n, quiet,
            group_delay_s=info.group_delay_s, preload_n=info.preload_n, mains_hz=info.mains_frequency_hz,
        )  # fmt: skip
    except TrialError as problem:
        raise CommandInputError(f"{path}: {problem}") from None
    return DrivingForce(*model.check_force_table(force.time_s, force.force_n, str(path)), info.preload_n)
