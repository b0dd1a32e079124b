"""What the virtual camera sees: the filmed bodies' geometry, outlines and textures, and its settings.

`camera` renders the scene built here; the tracker gets the outlines of `film_bodies`. Geometry is in metres, x right, y
up, angles counter-clockwise in rad. The picture is fixed to the ground; the place of its corner is in the ground frame.
The jack lies in front of the repetition lever, both in front of the whippen.

Pivots and rest angles are those of Hirschkorn 2004, as the thesis uses them; the outlines are drawn for this bench.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vision.angles import ccw_to_picture, ground_to_picture
from vision.bodies.masks import build_masks
from vision.bodies.outlines import Body
from vision.errors import InputError
from vision.fitting.pose_covariance import cramer_rao_bound
from vision.synthetic import Projection, Scene, SyntheticBody, background, speckle, thick_line, turned, wood_grain

NAMES = ("whippen", "jack", "repetition")


@dataclass(frozen=True)
class ActionGeometry:
    """Pivots and rest angles of the filmed bodies.

    Attributes
    ----------
    whippen_pivot_m : (float, float)
        In the ground frame.
    jack_pivot_m, repetition_pivot_m : (float, float)
        In the whippen's frame, whose origin is its own pivot.
    rest_angle_rad : (float, float, float)
        Whippen from ground, jack and repetition lever from the whippen, when the outlines are drawn.
    """

    whippen_pivot_m: tuple[float, float] = (-0.1810, 0.0528)
    jack_pivot_m: tuple[float, float] = (0.0989, -0.0035)
    repetition_pivot_m: tuple[float, float] = (0.0483, 0.0275)
    rest_angle_rad: tuple[float, float, float] = (0.0251, 0.3198, 0.3523)


@dataclass(frozen=True)
class CameraSettings:
    """Settings of the camera, and how the bodies look.

    Attributes
    ----------
    frame_rate_hz, exposure_s : float
    width, height : int
        Pixels.
    scale_px_per_m : float
    left_m, top_m : float
        Place of the picture's left and top edge in the ground frame.
    texture : {"wood", "speckle"}
    noise_grey : float
        Standard deviation per pixel, grey of 8 bit, before rounding.
    flicker : float
        Amplitude of the light's ripple as a fraction of its mean.
    flicker_hz : float
        Twice the mains frequency.
    bit_depth : {8, 12}
    lens : Projection or None
        A tilted camera or a distorting lens; None for a perfect one, square to the plane of motion.
    """

    frame_rate_hz: float = 2000.0
    exposure_s: float = 125e-6
    width: int = 400
    height: int = 304
    scale_px_per_m: float = 3200.0
    left_m: float = -0.173
    top_m: float = 0.125
    texture: str = "wood"
    noise_grey: float = 2.0
    flicker: float = 0.05
    flicker_hz: float = 120.0
    bit_depth: int = 8
    lens: Projection | None = None

    def __post_init__(self) -> None:
        if self.texture not in ("wood", "speckle"):
            raise InputError(f"camera texture {self.texture!r} is not known; choose wood or speckle")
        if self.bit_depth not in (8, 12):
            raise InputError(f"camera bit_depth {self.bit_depth} is not known; choose 8 or 12")
        for name in ("frame_rate_hz", "exposure_s", "scale_px_per_m"):
            if not 0.0 < getattr(self, name) < 1e9:
                raise InputError(f"camera {name} = {getattr(self, name)}; needs a positive number")
        if self.exposure_s * self.frame_rate_hz > 1.0:
            raise InputError(
                f"camera exposure_s = {self.exposure_s:g} is longer than a frame, "
                f"{1.0 / self.frame_rate_hz:g} s; shorten it"
            )
        if not (64 <= self.width <= 4096 and 64 <= self.height <= 4096):
            raise InputError(f"camera width x height = {self.width} x {self.height}; each side must be 64..4096 px")
        if not (0.0 <= self.noise_grey < 64.0 and 0.0 <= self.flicker < 1.0 and self.flicker_hz >= 0.0):
            raise InputError(
                f"camera noise_grey {self.noise_grey}, flicker {self.flicker}, flicker_hz {self.flicker_hz}; "
                "allowed are 0..64, 0..1 and 0 or more"
            )


def film_scene(settings: CameraSettings, seed: int) -> Scene:
    """Build the three textured bodies before a background, in drawing order."""
    grain = {"whippen": 0.0, "jack": np.pi / 2.0, "repetition": -0.05}
    bodies = []
    for number, name in enumerate(_DRAW_ORDER):
        polygon = ground_to_picture(_OUTLINES_M[name], settings.scale_px_per_m, (0.0, 0.0))
        low, high = polygon.min(axis=0) - 6.0, polygon.max(axis=0) + 6.0
        extent = (float(low[0]), float(low[1]), float(high[0]), float(high[1]))
        body_seed = 1000 * seed + number
        if settings.texture == "speckle":
            texture = speckle(extent, body_seed)
        else:
            texture = wood_grain(extent, body_seed, direction_rad=grain[name], mean_grey=120.0 + 15.0 * number)
        bodies.append(SyntheticBody(name, polygon, texture))
    return Scene(bodies, background(settings.height, settings.width, 1000 * seed + 99), settings.lens)


def film_bodies(geometry: ActionGeometry | None = None, settings: CameraSettings | None = None) -> list[Body]:
    """Outlines of the three bodies at rest, as a user would draw them on the first frame.

    Parameters
    ----------
    geometry : ActionGeometry, optional
        Its ``rest_angle_rad`` places the bodies.
    settings : CameraSettings, optional

    Returns
    -------
    list of Body
        Whippen, jack and repetition, the last two with the whippen as parent.

    Examples
    --------
    >>> from rig.simulated import film_bodies
    >>> [body.parent for body in film_bodies()]
    [None, 'whippen', 'whippen']
    """
    geometry, settings = geometry or ActionGeometry(), settings or CameraSettings()
    rest = np.asarray(geometry.rest_angle_rad, dtype=float)[None, :]
    place = dict(zip(_DRAW_ORDER, poses(geometry, settings, rest)[0], strict=True))
    bodies = []
    for name in NAMES:
        polygon = ground_to_picture(_OUTLINES_M[name], settings.scale_px_per_m, (0.0, 0.0))
        angle, x, y = place[name]
        outline = turned(polygon, float(ccw_to_picture(angle)), (x, y))
        if settings.lens is not None:
            outline = settings.lens.seen(outline)
        bodies.append(Body(name, outline, None if name == "whippen" else "whippen", _DRAW_ORDER.index(name)))
    return bodies


def film_bounds(
    scene: Scene, geometry: ActionGeometry, settings: CameraSettings, noise_grey: float
) -> NDArray[np.float64]:
    """Cramer-Rao bound of each body's angle in one still frame, rad, shape (3,), in the order of `NAMES`."""
    rest = np.asarray(geometry.rest_angle_rad, dtype=float)[None, :]
    picture = scene.light(poses(geometry, settings, rest))
    masks = build_masks(film_bodies(geometry, settings), settings.height, settings.width)
    return np.array([cramer_rao_bound(picture, mask, noise_grey)[0] for mask in masks])


_DRAW_ORDER = ("whippen", "repetition", "jack")
"""Back to front."""
_OUTLINES_M: dict[str, NDArray[np.float64]] = {
    # beam with the post that carries the repetition lever
    "whippen": np.array(
        [
            [-0.006, -0.006], [0.104, -0.0085], [0.106, 0.0035], [0.0525, 0.0055], [0.0525, 0.026],
            [0.0440, 0.026], [0.0440, 0.0055], [-0.006, 0.006],
        ]
    ),
    # upright arm and toe, 10 mm and 9 mm wide
    "jack": np.array(
        [
            [-0.0060, -0.0065], [0.0060, -0.0070], [0.0245, -0.0095], [0.0255, -0.0005], [0.0065, 0.0035],
            [0.0055, 0.0300], [0.0040, 0.0495], [-0.0050, 0.0500], [-0.0060, 0.0250],
        ]
    ),
    "repetition": thick_line(
        [[-0.036, -0.009], [-0.010, -0.001], [0.030, 0.002], [0.056, 0.002]], [0.007, 0.009, 0.008, 0.007]
    ),
}  # fmt: skip


def poses(geometry: ActionGeometry, settings: CameraSettings, angle_rad: NDArray[np.float64]) -> NDArray[np.float64]:
    """Poses for `Scene.light`, shape (k, 3, 3), from angles (k, 3), in drawing order."""
    whippen = angle_rad[:, 0]
    cosine, sine = np.cos(whippen), np.sin(whippen)
    pivot = np.asarray(geometry.whippen_pivot_m)
    origin = (-settings.left_m * settings.scale_px_per_m, settings.top_m * settings.scale_px_per_m)
    out = np.empty((len(angle_rad), 3, 3))
    places = {
        "whippen": ((0.0, 0.0), whippen),
        "jack": (geometry.jack_pivot_m, whippen + angle_rad[:, 1]),
        "repetition": (geometry.repetition_pivot_m, whippen + angle_rad[:, 2]),
    }
    for i, name in enumerate(_DRAW_ORDER):
        (x, y), angle = places[name]
        ground = pivot + np.column_stack([cosine * x - sine * y, sine * x + cosine * y])
        out[:, i, 0] = angle
        out[:, i, 1:] = ground_to_picture(ground, settings.scale_px_per_m, origin)
    return out
