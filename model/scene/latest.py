"""Scenes of the actions asked for last: a run asks twice for that of its action, runs of one draw ten times."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from threading import Lock
from typing import TypeVar

from model.parameters.action import Action
from model.scene.key_motion import KeyMotion
from model.scene.selection import SceneChoice

MOST = 256
"""Scenes kept, some 4 kB each: more than runs are carried out at one time."""
S = TypeVar("S")


def keeps_latest(build: Callable[..., S]) -> Callable[..., S]:
    """Give the scene of an action that was built for it before; none is kept of a prescribed motion."""
    kept: dict[tuple[int, SceneChoice], tuple[Action, S]] = {}
    lock = Lock()

    @wraps(build)
    def build_scene(action: Action, choice: SceneChoice | None = None, key_motion: KeyMotion | None = None) -> S:
        choice = SceneChoice() if choice is None else choice
        if key_motion is not None:
            return build(action, choice, key_motion)
        key = id(action), choice  # the action is kept with its scene, so that no other has its id
        with lock:
            found = kept.get(key)
        if found is None:
            found = action, build(action, choice)
            with lock:
                kept[key] = found
                while len(kept) > MOST:
                    del kept[next(iter(kept))]
        return found[1]

    return build_scene
