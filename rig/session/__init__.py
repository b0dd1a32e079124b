"""Session folders: raw trials sealed in HDF5, annotations, and results derived from them."""

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
