"""Compile what later tests use while the first ones run: `python -m tests.compile_ahead`, started by `conftest`.

A cold suite spends a third of its time compiling, on one processor. Here the scenes of later rooms go
into the same kernel cache from a process of its own. Each has one signature, so that two processes that compile the
same write the same. What is not ready in time is compiled by the test that needs it.
"""

from __future__ import annotations

import os

import numpy as np

import model
from model.kernels.codegen.load import energy_of, kernels_of
from model.scene.build import build_scene
from model.scene.key_motion import KeyMotion


def main() -> None:
    """Compile, in the order in which the suite meets them."""
    if hasattr(os, "nice"):
        os.nice(5)
    action = model.load_action()
    still = KeyMotion(np.array([0.0, 1.0]), np.zeros((1, 6)))
    kernels_of(build_scene(action, model.SceneChoice(effects=("motor_arm",))).tables)
    both = build_scene(action, model.SceneChoice(effects=("balance_rail", "shank"))).tables
    kernels_of(both)
    kernels_of(build_scene(action, key_motion=still).tables)
    energy_of(both)


if __name__ == "__main__":
    main()
