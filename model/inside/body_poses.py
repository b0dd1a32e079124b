"""Poses of the bodies along a motion, with place, depth and force of each contact; no losses."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from model.codegen import observable_columns as C
from model.errors import InputError
from model.inside.state_observer import Observer
from model.scene.build import Scene

Array = NDArray[np.float64]


@dataclass(frozen=True)
class SeenMotion:
    """A motion at (m,) times, with contacts (c) and bodies (n)."""

    scene: Scene  # elements of the run, with all their numbers
    time_s: Array  # (m,)
    pose: Array  # (m, n, 3) pivot x, y (m) and orientation from ground (rad)
    point_m: Array  # (m, c, 2) where the force acts
    penetration_m: Array  # (m, c) depth of the felt, negative where the gap is open
    normal_n: Array  # (m, c) normal force

    @property
    def contacts(self) -> tuple[str, ...]:
        return self.scene.contacts

    @property
    def bodies(self) -> tuple[str, ...]:
        """Names of the coordinates."""
        return self.scene.bodies


def observe_poses(
    scene: Scene,
    time_s: Array,
    angle_rad: Array,
    speed_rad_per_s: Array,
    force_n: Array,
    normal_n: Array | None = None,
) -> SeenMotion:
    """Poses, contact points, depths and forces at states (m, n), rad, rad/s, under forces (m,), N, on the key;
    ``normal_n`` (m, contacts), N, must be given where felt remembers, a string, joints that give or a drive take part.
    """
    scene_of_places = scene
    if normal_n is None:
        found = [*scene.what_remembers, *dict.fromkeys(f"{body}_pin" for body, _ in scene.pins)]
        if found or scene.command is not None:
            raise InputError(
                "forces of a drawing from angles alone: found felt that remembers, a string, joints that give or a "
                f"drive ({', '.join(found) or scene.presser}), allowed none of these; give the forces"
            )
        rows = None
    else:  # for places and depths only: felt as if it remembered nothing, joints where they are drawn
        scene_of_places = replace(scene, tables=scene.static_tables)
        rows = np.zeros((len(angle_rad), 2 * len(scene.pins)))
    seen = Observer(scene_of_places).evaluate(angle_rad, speed_rad_per_s, force_n, rows)
    return SeenMotion(
        scene=scene,
        time_s=time_s,
        pose=seen.poses(),
        point_m=seen.contact[:, :, C.X : C.Y + 1],
        penetration_m=seen.contact[:, :, C.DEPTH],
        normal_n=seen.contact[:, :, C.NORMAL] if normal_n is None else normal_n,
    )
