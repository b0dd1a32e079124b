"""The force that drives a simulation: a table, or a recorded trial with its force as ``validate`` corrects it."""

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

    def force_at(self, time_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """The force (m,) at times (m,), linear between those of the table."""
        return np.interp(as_numbers(time_s, "times", 1), self.time_s, self.force_n)

    def rest(self, action: model.Action, scene: model.SceneChoice) -> model.RestState | None:
        """Where the blow starts: at rest under the preload; None, the usual rest state, where there is none."""
        if not self.preload_n:
            return None
        return model.rest_state(action, force_n=self.preload_n, scene=model.build_scene(action, scene))


TABLE_ENDINGS = (".lvm", ".tdms", ".h5", ".hdf5", ".nc", ".mat", ".txt", ".tsv", ".dat", ".asc", ".prn", ".gz")
"""Files that are tables with the channels ``time_s`` and ``force_n`` in another format than CSV."""


def read_driving_force(path: Path, column: str = "force_n", mapping: Path | None = None) -> DrivingForce:
    """Read what drives a simulation: the column of a table, or the corrected force, N, with preload, of a sealed trial
    or of a recording that a mapping explains.

    The force of a trial, and of a recording with a mapping, is corrected as in a comparison: offset, mains hum and
    group delay are taken off, the preload of the arm stays. That of a table is taken as it is.

    Raises
    ------
    CommandInputError : a trial cannot drive this scene, or its force cannot be corrected
    model.InputError : a table that cannot be used
    rig.RigInputError : a file or mapping that cannot be used, or a trial altered since it was sealed
    """
    if mapping is None and path.suffix.lower() not in TABLE_ENDINGS:
        try:
            return DrivingForce(*model.read_force_table(path, column))
        except model.InputError as problem:
            if path.suffix.lower() != ".csv" or not path.is_file():
                raise
            return _read_recording(path, column, problem)
    if mapping is None and not _is_trial(path):
        return _read_recording(path, column)
    if column != "force_n":
        raise CommandInputError(f"{path}: a trial records a force, this scene is driven by {column}; give a CSV table")
    # start-up: pandas and h5py cost 0.4 s that a table does not need
    from rig import RigInputError, load_mapping, read_recording
    from rig.session.sealed_trial import read_trial

    data = read_trial(path) if mapping is None else read_recording(path, load_mapping(mapping))
    if not data.has_force:
        raise CommandInputError(f"{path}: no force was recorded, positions only; give a trial with a force or a table")
    try:
        force = data.corrected_force()
    except RigInputError as problem:
        raise CommandInputError(f"{path}: {problem}") from None
    return DrivingForce(*model.check_force_table(force.time_s, force.force_n, str(path)), force.preload_n)


def _read_recording(path: Path, column: str, problem: Exception | None = None) -> DrivingForce:
    """Read times and the channel ``column`` of a foreign recording; ``problem``: why the file is no plain table, said
    in the error where it cannot be read either."""
    # start-up: h5py costs 0.1 s that a CSV table does not need
    from rig.errors import RigInputError
    from rig.foreign.reading import UncorrectedForceError, read_force

    try:
        return DrivingForce(*model.check_force_table(*read_force(path, column), str(path), column))
    except UncorrectedForceError:
        raise
    except RigInputError as error:
        if path.suffix.lower() in (".h5", ".hdf5", ".tdms") or not path.is_file():
            raise
        raise CommandInputError(
            f"{problem or error}; for other names, separators or units: pianorig info {path} --propose lab.toml, then "
            "--mapping lab.toml"
        ) from None


def _is_trial(path: Path) -> bool:
    """Whether a file is to be read as a sealed trial: an ``.h5`` file that has a trial's schema, or that HDF5 cannot
    open, so that the error is the trial's."""
    if path.suffix.lower() != ".h5":
        return False
    import h5py  # start-up: 0.1 s that a CSV table does not need

    try:
        with h5py.File(path, "r") as file:
            return "schema" in file.attrs
    except OSError:
        return True
