"""The file a task logs its samples to on the server's side (TDMS), as the driver's logging does.

Values are written scaled, one TDMS channel a channel of the task, with start time, interval and unit where they are
known. Needs npTDMS (extra ``tdms``).
"""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rig.simulated.status import Code, DaqStatusError

if TYPE_CHECKING:
    from nptdms import TdmsWriter

OFF, LOG, LOG_AND_READ = 10231, 15844, 15842
OPEN, OPEN_OR_CREATE, CREATE_OR_REPLACE, CREATE = 10437, 15846, 15847, 15848


@dataclass(frozen=True)
class LogSettings:
    """What a client asks to be logged: mode, path, group and operation, by the driver's numbers."""

    mode: int = OFF
    path: str = ""
    group: str = ""
    operation: int = CREATE


class TdmsLog:
    """One open file; each block of samples is a segment of its own.

    Parameters
    ----------
    path : str
        As the client gave it; relative to the server's folder.
    operation : int
        Whether the file must exist, may, or is replaced.
    group : str
        Name of the group of channels.
    names : list of str
        Names of the channels.
    interval_s : float
        Time between two samples, s; 0 where it is not known.

    Raises
    ------
    DaqStatusError
        When npTDMS is missing, or the file cannot be opened so.
    """

    def __init__(self, path: str, operation: int, group: str, names: list[str], interval_s: float) -> None:
        file = Path(path)
        if not file.resolve().is_relative_to(Path.cwd()):
            raise DaqStatusError(Code.FILE_PATH_INVALID, f"{path!r}: the virtual device logs into {Path.cwd()} only")
        exists = file.is_file()
        if (operation == OPEN and not exists) or (operation == CREATE and exists) or not path:
            what = "does not exist" if operation == OPEN else "exists" if exists else "no path"
            raise DaqStatusError(Code.FILE_PATH_INVALID, f"{path!r}: {what}")
        try:
            from nptdms import TdmsWriter  # start-up: an optional package, only logging needs it
        except ImportError:
            raise DaqStatusError(Code.TDMS_NOT_FOUND, "pip install 'piano-action-rig[tdms]'") from None
        self._group, self._names = group, names
        self._properties: dict[str, Any] = {"wf_start_time": datetime.now(UTC).replace(tzinfo=None)}
        if interval_s > 0:
            self._properties |= {"wf_increment": interval_s, "wf_start_offset": 0.0}
        try:
            mode = "a" if exists and operation in (OPEN, OPEN_OR_CREATE) else "w"
            self._writer: TdmsWriter = TdmsWriter(path, mode=mode)
            self._writer.open()
        except OSError as error:
            raise DaqStatusError(Code.FILE_PATH_INVALID, f"{path!r}: {error.strerror}") from None

    def write(self, values: NDArray[np.float64]) -> None:
        """Append samples, (n, channels)."""
        from nptdms import ChannelObject  # start-up: as above

        try:
            self._writer.write_segment(
                [
                    ChannelObject(self._group, name, np.ascontiguousarray(values[:, k]), properties=self._properties)
                    for k, name in enumerate(self._names)
                ]
            )
        except OSError as error:
            raise DaqStatusError(Code.GENERIC_FILE_IO, str(error.strerror)) from None
        self._properties = {}

    def close(self) -> None:
        """Close the file."""
        self._writer.close()
