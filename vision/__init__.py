"""Angles from high-speed film: readers, rigid-body tracker, uncertainty, synthetic films.

Takes a film and body outlines, gives angles counter-clockwise in rad with a standard uncertainty per frame.
Imports nothing of the other packages. Names are loaded on first use, so that outlines and errors cost neither
OpenCV nor numba.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from vision.avi import write_avi as write_avi
    from vision.bodies import Body as Body
    from vision.bodies import load_bodies as load_bodies
    from vision.bodies import save_bodies as save_bodies
    from vision.camera_model import AssumedCamera as AssumedCamera
    from vision.camera_model import CalibratedCamera as CalibratedCamera
    from vision.error_budget import ErrorBudget as ErrorBudget
    from vision.errors import BodyError as BodyError
    from vision.errors import FilmError as FilmError
    from vision.errors import InputError as InputError
    from vision.errors import TrackingError as TrackingError
    from vision.errors import VisionError as VisionError
    from vision.errors import VisionWarning as VisionWarning
    from vision.flags import FrameFlag as FrameFlag
    from vision.frames import ArrayFilm as ArrayFilm
    from vision.frames import Film as Film
    from vision.frames import FrameSource as FrameSource
    from vision.frames import open_film as open_film
    from vision.overlay import write_contact_sheet as write_contact_sheet
    from vision.overlay import write_overlay as write_overlay
    from vision.plots import write_plot as write_plot
    from vision.preparation import predict_uncertainty as predict_uncertainty
    from vision.results import TrackResult as TrackResult
    from vision.timing import estimate_offset as estimate_offset
    from vision.timing import times_of_counts as times_of_counts
    from vision.timing import times_of_edges as times_of_edges
    from vision.track import retrack_frames as retrack_frames
    from vision.track import track_film as track_film
    from vision.writers import write_mraw as write_mraw

_HOME = {
    "ArrayFilm": "frames",
    "AssumedCamera": "camera_model",
    "Body": "bodies",
    "BodyError": "errors",
    "CalibratedCamera": "camera_model",
    "ErrorBudget": "error_budget",
    "estimate_offset": "timing",
    "Film": "frames",
    "FilmError": "errors",
    "FrameFlag": "flags",
    "FrameSource": "frames",
    "InputError": "errors",
    "load_bodies": "bodies",
    "open_film": "frames",
    "predict_uncertainty": "preparation",
    "retrack_frames": "track",
    "save_bodies": "bodies",
    "times_of_counts": "timing",
    "times_of_edges": "timing",
    "track_film": "track",
    "TrackingError": "errors",
    "TrackResult": "results",
    "VisionError": "errors",
    "VisionWarning": "errors",
    "write_avi": "avi",
    "write_contact_sheet": "overlay",
    "write_mraw": "writers",
    "write_overlay": "overlay",
    "write_plot": "plots",
}
__all__ = list(_HOME)


def __getattr__(name: str) -> Any:
    home = _HOME.get(name)
    if home is None:
        raise AttributeError(f"module 'vision' has no attribute {name!r}")
    value = getattr(import_module(f"vision.{home}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *_HOME})
