"""Angles from high-speed film: readers, rigid-body tracker, uncertainty, synthetic films.

Takes a film and body outlines, gives angles counter-clockwise in rad with a standard uncertainty per frame.
Imports nothing of the other packages. Names are loaded on first use, so that outlines and errors cost neither
OpenCV nor numba.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from vision.bodies.outlines import Body as Body
    from vision.bodies.outlines import load_bodies as load_bodies
    from vision.bodies.outlines import save_bodies as save_bodies
    from vision.camera.model import AssumedCamera as AssumedCamera
    from vision.camera.model import CalibratedCamera as CalibratedCamera
    from vision.errors import BodyError as BodyError
    from vision.errors import FilmError as FilmError
    from vision.errors import InputError as InputError
    from vision.errors import TrackingError as TrackingError
    from vision.errors import VisionError as VisionError
    from vision.errors import VisionWarning as VisionWarning
    from vision.film.avi_writer import write_avi as write_avi
    from vision.film.mraw_writer import write_mraw as write_mraw
    from vision.film.source import ArrayFilm as ArrayFilm
    from vision.film.source import Film as Film
    from vision.film.source import FrameSource as FrameSource
    from vision.film.source import open_film as open_film
    from vision.output.overlay import write_contact_sheet as write_contact_sheet
    from vision.output.overlay import write_overlay as write_overlay
    from vision.output.plots import write_plot as write_plot
    from vision.timing import estimate_offset as estimate_offset
    from vision.timing import times_of_counts as times_of_counts
    from vision.timing import times_of_edges as times_of_edges
    from vision.tracking.flags import FrameFlag as FrameFlag
    from vision.tracking.prepare import predict_uncertainty as predict_uncertainty
    from vision.tracking.result import TrackResult as TrackResult
    from vision.tracking.track_film import retrack_frames as retrack_frames
    from vision.tracking.track_film import track_film as track_film
    from vision.uncertainty.budget import ErrorBudget as ErrorBudget

_HOME = {
    "ArrayFilm": "film.source",
    "AssumedCamera": "camera.model",
    "Body": "bodies.outlines",
    "BodyError": "errors",
    "CalibratedCamera": "camera.model",
    "ErrorBudget": "uncertainty.budget",
    "estimate_offset": "timing",
    "Film": "film.source",
    "FilmError": "errors",
    "FrameFlag": "tracking.flags",
    "FrameSource": "film.source",
    "InputError": "errors",
    "load_bodies": "bodies.outlines",
    "open_film": "film.source",
    "predict_uncertainty": "tracking.prepare",
    "retrack_frames": "tracking.track_film",
    "save_bodies": "bodies.outlines",
    "times_of_counts": "timing",
    "times_of_edges": "timing",
    "track_film": "tracking.track_film",
    "TrackingError": "errors",
    "TrackResult": "tracking.result",
    "VisionError": "errors",
    "VisionWarning": "errors",
    "write_avi": "film.avi_writer",
    "write_contact_sheet": "output.overlay",
    "write_mraw": "film.mraw_writer",
    "write_overlay": "output.overlay",
    "write_plot": "output.plots",
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
