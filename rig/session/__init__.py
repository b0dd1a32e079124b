"""Session folders: raw trials sealed in HDF5, annotations, and results derived from them.

In: trials of the recorder or an import; films and annotations added later.
Out: the same, for ``vision`` and ``validation``; reading imports neither the NI-DAQmx client nor numba.
Conventions: SI units, time first, time zero is the AI start trigger of the trial.
"""

from rig.session.annotation_file import Annotation
from rig.session.folder import Session, Trial
from rig.session.info import ChannelInfo, EncoderInfo, ForceInfo, SessionInfo
from rig.session.trial_data import CameraInfo, TrialData

__all__ = [
    "Annotation",
    "CameraInfo",
    "ChannelInfo",
    "EncoderInfo",
    "ForceInfo",
    "Session",
    "SessionInfo",
    "Trial",
    "TrialData",
]
