"""Measured quantities as functions of the state: what a ruler or a sensor at the action would read."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.arrays import as_numbers
from model.errors import InputError
from model.parameters.action import BODIES, CAPSTAN, KEY_FRONT, STRING, ActionLike, as_action
from model.parameters.effects import SHANK

PIN = ("hammer_pin_x", "hammer_pin_y")
APPROACH_S = 1e-4  # to either side, and twice that, at which heights are compared for a speed


def _column(angle_rad: ArrayLike, body: str) -> NDArray[np.float64]:
    angles = as_numbers(angle_rad, "angles of the bodies")
    if angles.ndim == 0 or angles.shape[-1] < len(BODIES):
        raise InputError(f"angles of the bodies: found shape {angles.shape}, allowed (..., {len(BODIES)})")
    return angles[..., BODIES.index(body)]


def hammer_height_from_angle(action: ActionLike, hammer_rad: ArrayLike) -> NDArray[np.float64]:
    """Distance (m) from the hammer's striking surface to the string, 0 at touch, negative where felt is pressed in,
    from the hammer's angle from ground, rad, alone (rigid shank and pivot).

    Parameters
    ----------
    action : geometry
    hammer_rad : (...,) angle of the hammer from ground, rad

    Returns
    -------
    ndarray
        Height (...,), m, negative where the felt is pressed in.

    Examples
    --------
    >>> import model
    >>> action = model.load_action("hirschkorn2004-regulated")
    >>> hammer_rad = model.rest_state(action).angle_rad[model.BODIES.index("hammer")]
    >>> print(f"{1e3 * model.observables.hammer_height_from_angle(action, hammer_rad):.1f} mm")
    48.0 mm
    """
    action = as_action(action)
    theta = as_numbers(hammer_rad, "angle of the hammer")
    x, y = action[f"{STRING}.first.x"], action[f"{STRING}.first.y"]
    c, s = np.cos(theta), np.sin(theta)
    px = action["hammer.pivot.x"] + c * x - s * y
    py = action["hammer.pivot.y"] + s * x + c * y
    nx, ny = action[f"{STRING}.second.normal.x"], action[f"{STRING}.second.normal.y"]
    length = np.hypot(nx, ny)
    gap = (px - action[f"{STRING}.second.x"]) * nx + (py - action[f"{STRING}.second.y"]) * ny
    return gap / length - action[f"{STRING}.first.radius"]


def hammer_height_m(
    action: ActionLike, angle_rad: ArrayLike, shank_rad: ArrayLike | None = None, give_m: ArrayLike | None = None
) -> NDArray[np.float64]:
    """Distance (m) from the hammer's striking surface to the string, 0 at touch, negative beyond, at angles (..., 5),
    rad, ``shank_rad``: the head's bend from the straight shank, ``give_m`` (..., 2): pivot's shift right, up.

    Where the shank bends, ``shank_rad`` is the head's angle from the straight shank; without it the height is that of a
    straight hammer, which is what an encoder at the pivot tells.

    Parameters
    ----------
    action : geometry
    angle_rad : (m, n) angles of the bodies, rad
    shank_rad : (m,) bend of the shank, rad; by default none
    give_m : (m, 2) how far the hammer's joint gives, to the right and up, m; by default not

    Returns
    -------
    ndarray
        Height (m,), m, negative where the felt is pressed in.

    Examples
    --------
    >>> import model
    >>> action = model.load_action("hirschkorn2004")
    >>> solution = model.simulate(action, *model.force_table("forte"))
    >>> print(f"{1e3 * model.observables.hammer_height_m(action, solution.angle_rad)[0]:.0f} mm at rest")
    48 mm at rest
    """
    action = as_action(action)
    theta = _column(angle_rad, "hammer")
    if give_m is not None:
        return hammer_height_m(action, angle_rad, shank_rad) + string_normal_component(action, give_m)
    if shank_rad is None:
        return hammer_height_from_angle(action, theta)
    # the head turned about the hinge: as a whole hammer turned by both angles, its pivot moved along
    turned = theta + as_numbers(shank_rad, "bend of the shank")
    hinge = complex(action["shank.hinge.x"], action["shank.hinge.y"])
    way = hinge * (np.exp(1j * theta) - np.exp(1j * turned))
    normal = complex(action[f"{STRING}.second.normal.x"], action[f"{STRING}.second.normal.y"])
    along = np.real(way * normal.conjugate()) / abs(normal)
    return np.asarray(hammer_height_from_angle(action, turned) + along)


def head_height_m(action: ActionLike, coordinates: Sequence[str], rows: ArrayLike) -> NDArray[np.float64]:
    """Distance (m) of the hammer's head from the string, 0 at touch, negative beyond, at ``rows`` (..., k), rad and m,
    of the named ``coordinates`` (k,), shank and pivot directions among them where they give.

    Parameters
    ----------
    action : geometry
    coordinates : (k,) names of the columns, the hammer among them: bodies and effects of a scene, then directions in
        which joints give, such as ``hammer_pin_x`` (`model.scene.build.Scene.coordinates`)
    rows : (..., k) rad, m

    Returns
    -------
    ndarray
        Height (...,), m, negative where the felt is pressed in.

    Examples
    --------
    >>> import model
    >>> action = model.load_action("hirschkorn2004")
    >>> at_rest = [*model.rest_state(action).angle_rad, -1e-3]
    >>> height = model.observables.head_height_m(action, (*model.BODIES, "hammer_pin_y"), at_rest)
    >>> print(f"{1e3 * float(height):.0f} mm where the joint has given way by 1 mm")
    49 mm where the joint has given way by 1 mm
    """
    action = as_action(action)
    values, names = np.moveaxis(as_numbers(rows, "coordinates"), -1, 0), list(coordinates)
    column = dict(zip(names, values, strict=True))
    bodies = np.repeat(column["hammer"][..., None], len(BODIES), axis=-1)  # only the hammer's is read
    gives = [column.get(name, np.zeros_like(column["hammer"])) for name in PIN]
    given = np.stack(gives, axis=-1) if column.keys() & set(PIN) else None
    return hammer_height_m(action, bodies, column.get(SHANK), given)


def head_approach_m_per_s(
    action: ActionLike, coordinates: Sequence[str], rows: ArrayLike, rates: ArrayLike
) -> NDArray[np.float64]:
    """Speed (m/s) of the hammer's head, positive towards the string, at ``rows`` (..., k), rad and m, of the named
    ``coordinates`` (k,), and ``rates`` (..., k), per s.

    Parameters
    ----------
    action : geometry
    coordinates : (k,) as for `head_height_m`
    rows, rates : (..., k) rad, m, and per s

    Returns
    -------
    ndarray
        Speed (...,), m/s, positive towards the string.

    Examples
    --------
    >>> import model
    >>> action = model.load_action("hirschkorn2004")
    >>> at_rest, falls = [*model.rest_state(action).angle_rad, 0.0], [0.0] * 5 + [-1.0]
    >>> speed = model.observables.head_approach_m_per_s(action, (*model.BODIES, "hammer_pin_y"), at_rest, falls)
    >>> print(f"{float(speed):.3f}")
    -1.000
    """
    action = as_action(action)
    at, way = as_numbers(rows, "coordinates"), APPROACH_S * as_numbers(rates, "their rates")
    near, far = (
        head_height_m(action, coordinates, at - s * way) - head_height_m(action, coordinates, at + s * way)
        for s in (1.0, 2.0)
    )
    # central difference of the fourth order
    return np.asarray((8.0 * near - far) / (12.0 * APPROACH_S))


def string_normal_component(action: ActionLike, way: ArrayLike) -> NDArray[np.float64]:
    """Component of vectors (..., 2), right and up in the world, along the unit normal of the string, which points at
    the hammer; in their unit.

    Parameters
    ----------
    action : geometry
    way : (..., 2) to the right and up, in any unit

    Returns
    -------
    ndarray
        (...,), in the same unit.

    Raises
    ------
    InputError : vectors that are not (..., 2)

    Examples
    --------
    >>> import model
    >>> float(model.observables.string_normal_component(model.load_action(), [0.0, 1e-3]))
    -0.001
    """
    action = as_action(action)
    normal = np.array([action[f"{STRING}.second.normal.x"], action[f"{STRING}.second.normal.y"]])
    ways = as_numbers(way, "vectors along the normal of the string")
    if ways.ndim == 0 or ways.shape[-1] != 2:
        raise InputError(f"vectors along the normal of the string: found shape {ways.shape}, allowed (..., 2)")
    return np.asarray(ways @ (normal / np.hypot(*normal)))


def encoder_rad(angle_rad: ArrayLike, lift_m: ArrayLike, radius_m: float) -> NDArray[np.float64]:
    """Angle (rad) that an optical scale of ``radius_m`` on the key reads, whose sensor stands on the front side: the
    true angle plus the pivot's rise ``lift_m`` over the radius, too small a turn of a pressed key.

    As in the thesis (3.2.2).

    Parameters
    ----------
    angle_rad : (m,) true angle, rad
    lift_m : (m,) rise of the body's centre, m
    radius_m : radius of the scale, m

    Returns
    -------
    ndarray
        Reading (m,), rad.

    Examples
    --------
    >>> import model
    >>> model.observables.encoder_rad([-0.05], [1e-4], 0.04)
    array([-0.0475])
    """
    return as_numbers(angle_rad, "angle") + as_numbers(lift_m, "lift") / radius_m


def key_front_height_m(action: ActionLike, angle_rad: ArrayLike) -> NDArray[np.float64]:
    """Height (m), in the ground frame, of the point of the key where the force acts, at angles (m, 5), rad; the key's
    pivot at its place.

    Parameters
    ----------
    action : geometry
    angle_rad : (m, n) angles of the bodies, rad

    Returns
    -------
    ndarray
        Height (m,), m.

    Examples
    --------
    >>> import model
    >>> action = model.load_action()
    >>> model.observables.key_front_height_m(action, model.rest_state(action).angle_rad[None, :]).shape
    (1,)
    """
    action = as_action(action)
    theta = _column(angle_rad, "key")
    x, y = action["drive.point.x"], action["drive.point.y"]
    return action["key.pivot.y"] + np.sin(theta) * x + np.cos(theta) * y


def key_dip_m(action: ActionLike, angle_rad: ArrayLike, rest_rad: ArrayLike | None = None) -> NDArray[np.float64]:
    """How far (m, positive down) the key front is below its rest, at angles (m, 5), rad; ``rest_rad`` (5,): angles at
    rest, by default the first row.

    Parameters
    ----------
    action : geometry
    angle_rad : (m, n) angles of the bodies, rad
    rest_rad : (n,) angles at rest; by default the first row of ``angle_rad``

    Returns
    -------
    ndarray
        Dip (m,), m, positive downwards.

    Examples
    --------
    >>> import model
    >>> action = model.load_action("hirschkorn2004-regulated")
    >>> solution = model.simulate(action, *model.force_table("forte"))
    >>> print(f"{1e3 * model.observables.key_dip_m(action, solution.angle_rad).max():.1f} mm")
    11.2 mm
    """
    action = as_action(action)
    angles = as_numbers(angle_rad, "angles of the bodies")
    rest = angles[:1] if rest_rad is None else as_numbers(rest_rad, "angles at rest", 1)[None, :]
    return key_front_height_m(action, rest) - key_front_height_m(action, angles)


def key_front_gap_m(action: ActionLike, angle_rad: ArrayLike) -> NDArray[np.float64]:
    """Gap (m) between the key's underside and the felt under its front, 0 at first touch, negative where pressed in, at
    angles (m, 5), rad.

    Parameters
    ----------
    action : geometry
    angle_rad : (m, n) angles of the bodies, rad

    Returns
    -------
    ndarray
        Gap (m,), m, negative where the felt is pressed in.

    Examples
    --------
    >>> import model
    >>> action = model.load_action("hirschkorn2004-regulated")
    >>> at_rest = model.rest_state(action).angle_rad[None, :]
    >>> bool(model.observables.key_front_gap_m(action, at_rest)[0] > 0.0)
    True
    """
    action = as_action(action)
    theta = _column(angle_rad, "key")
    c, s = np.cos(theta), np.sin(theta)
    x, y = action[f"{KEY_FRONT}.second.x"], action[f"{KEY_FRONT}.second.y"]
    nx, ny = action[f"{KEY_FRONT}.second.normal.x"], action[f"{KEY_FRONT}.second.normal.y"]
    along_x = action[f"{KEY_FRONT}.first.x"] - action["key.pivot.x"] - (c * x - s * y)
    along_y = action[f"{KEY_FRONT}.first.y"] - action["key.pivot.y"] - (s * x + c * y)
    reach = (along_x * (c * nx - s * ny) + along_y * (s * nx + c * ny)) / np.hypot(nx, ny)
    return np.asarray(reach - action[f"{KEY_FRONT}.first.radius"], dtype=float)


def capstan_gap_m(action: ActionLike, angle_rad: ArrayLike) -> NDArray[np.float64]:
    """Gap (m) between the key's capstan and the whippen's heel, negative where pressed, at angles (m, 5), rad.

    Parameters
    ----------
    action : geometry
    angle_rad : (m, n) angles of the bodies, rad

    Returns
    -------
    ndarray
        Gap (m,), m, negative where the felt is pressed in.

    Examples
    --------
    >>> import model
    >>> action = model.load_action("hirschkorn2004-regulated")
    >>> at_rest = model.rest_state(action).angle_rad[None, :]
    >>> bool(model.observables.capstan_gap_m(action, at_rest)[0] < 0.0)  # the key carries the whippen
    True
    """
    action = as_action(action)
    key, whippen = _column(angle_rad, "key"), _column(angle_rad, "whippen")

    def centre(body: str, side: str, theta: NDArray[np.float64]) -> NDArray[np.complex128]:
        pivot = complex(action[f"{body}.pivot.x"], action[f"{body}.pivot.y"])
        local = complex(action[f"{CAPSTAN}.{side}.x"], action[f"{CAPSTAN}.{side}.y"])
        return np.asarray(pivot + np.exp(1j * theta) * local)

    apart = np.abs(centre("key", "first", key) - centre("whippen", "second", whippen))
    return np.asarray(apart - action[f"{CAPSTAN}.first.radius"] - action[f"{CAPSTAN}.second.radius"], dtype=float)
