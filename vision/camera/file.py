"""The camera file that ``pianorig calibrate-camera`` writes and ``track --calibration`` reads (TOML).

Lengths in m, pixels of the film, standard uncertainties as a covariance.
"""

from __future__ import annotations

import os
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from vision.atomic_write import whole_file
from vision.camera.model import CalibratedCamera
from vision.errors import VisionInputError


def save_calibration(path: str | os.PathLike[str], camera: CalibratedCamera, notes: Mapping[str, Any]) -> None:
    """Write a camera file, whole or not at all.

    Parameters
    ----------
    path : path
    camera : CalibratedCamera
    notes : mapping
        Numbers and texts that say how it was made; they are not read again.

    Examples
    --------
    >>> import numpy as np
    >>> import vision
    >>> seen = vision.CalibratedCamera(280, 212, np.zeros(5), np.zeros((5, 5)), 2240.0, 1.0)
    >>> vision.save_calibration("camera.toml", seen, {"target": "checkerboard", "pitch_mm": 5.0})
    """
    path = Path(path)
    lines = [
        "# View of the plane of motion: homography [[1 + a, b, 0], [b, 1 - a, 0], [p / R, q / R, 1]] about the",
        "# picture's centre, R half its diagonal; then radial distortion k, the displacement at the corner over R.",
        "[camera]",
        f"width_px = {camera.width}",
        f"height_px = {camera.height}",
        f"parameters = {[float(v) for v in camera.parameters]}  # a, b, p, q, k",
        f"covariance = {[[float(v) for v in row] for row in camera.covariance]}",
        f"scale_px_per_m = {float(camera.scale_px_per_m)!r}",
        f"u_scale_px_per_m = {float(camera.u_scale_px_per_m)!r}",
        "",
        "[made_from]",
    ]
    for name, value in notes.items():
        text = str(value).replace("\\", "\\\\").replace('"', '\\"')
        number = isinstance(value, int | float)
        lines.append(
            f"{name} = {value if isinstance(value, int) else float(value)!r}" if number else f'{name} = "{text}"'
        )
    with whole_file(path, VisionInputError, "choose a writable folder") as temporary:
        temporary.write_text("\n".join(lines) + "\n", encoding="utf-8", newline="\n")


def load_calibration(path: str | os.PathLike[str]) -> CalibratedCamera:
    """Read a camera file.

    Parameters
    ----------
    path : path
        Written by `save_calibration` or ``pianorig calibrate-camera``.

    Returns
    -------
    CalibratedCamera

    Raises
    ------
    VisionInputError
        The file is missing or incomplete; the message names the key.

    Examples
    --------
    >>> import numpy as np
    >>> import vision
    >>> seen = vision.CalibratedCamera(280, 212, np.zeros(5), np.zeros((5, 5)), 2240.0, 1.0)
    >>> vision.save_calibration("camera.toml", seen, {"made": "by hand"})
    >>> vision.load_calibration("camera.toml").scale_px_per_m
    2240.0
    """
    path = Path(path)
    try:
        with path.open("rb") as file:
            document = tomllib.load(file)
    except OSError as error:
        raise VisionInputError(f"{path}: cannot be read ({error.strerror}); give a file of calibrate-camera") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise VisionInputError(f"{path}: not valid TOML ({error}); run calibrate-camera again") from None
    table = document.get("camera")
    if not isinstance(table, dict):
        raise VisionInputError(f"{path}: holds no [camera] table; give a file of calibrate-camera")
    try:
        width, height = table["width_px"], table["height_px"]
        if not (isinstance(width, int) and isinstance(height, int) and width > 0 and height > 0):
            raise VisionInputError(f"width_px and height_px are {width!r} and {height!r}, need whole numbers above 0")
        return CalibratedCamera(
            width,
            height,
            table["parameters"],
            table["covariance"],
            float(table["scale_px_per_m"]),
            float(table["u_scale_px_per_m"]),
        )
    except KeyError as error:
        raise VisionInputError(f"{path}: key camera.{error.args[0]} is missing; run calibrate-camera again") from None
    except (TypeError, ValueError) as error:
        raise VisionInputError(f"{path}: {error}; run calibrate-camera again") from None
