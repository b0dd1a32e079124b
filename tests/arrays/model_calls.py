"""The smallest call of what the model offers that takes arrays: by name, what makes its arguments.

An array is written as it is; `tests.arrays.forms` gives it every other form. ``self`` is the object of a method. Of
those that would take seconds `HEAVY` names the step at which the test stops, after others that are left out: what
reaches it (or with ``gives`` what it gives) is the answer. `ANY_SHAPE` names those whose arrays may have any shape.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

import model
from model.force_driven import ForceDrivenOptions
from tests.arrays.forms import Gives, Out, plain

Arguments = dict[str, Any]
STUDY, TOUCH = "model.study", "model.touch"
ANY_SHAPE = (
    *(f"model.observables.{name}" for name in vars(model.observables)),
    "model.Scene.check_whole",
)
HEAVY = {
    "model.inside.draw_sheet": ("model.inside.figure._draw_motion",),
    "model.measure_touch": (f"{TOUCH}.measure.weigh", f"{TOUCH}.measure.hammer_speeds"),
    f"{TOUCH}.fastest_repetition": (f"{TOUCH}.measure.strikes_string",),
    f"{STUDY}.compare": (f"{STUDY}.variants.simulate_many",),
}

TIME, FORCE = np.array([0.0, 1.0]), np.array([0.0, 4.0])
OUTPUTS = np.array([0.0, 0.0, 1.0 / 256.0])
ROWS = np.arange(24.0)
TABLE: Arguments = {"time_s": TIME, "force_n": FORCE}


@cache
def action() -> model.Action:
    return model.load_action("hirschkorn2004-regulated")


@cache
def scene() -> model.Scene:
    return model.build_scene(action())


@cache
def rest() -> np.ndarray:
    """Angles at which the action rests, in numbers that float32 holds."""
    return plain(model.rest_state(action()).angle_rad)


def driven() -> model.SceneChoice:
    """The key alone under a motor with its drive: the whole action would take five times as long to compile."""
    return replace(model.load_scene("motor-drive"), bodies=("key",))


@cache
def blow(by_drive: bool = False) -> model.Solution:
    """The first milliseconds of a press: of the key by its force, or of a motor's drive."""
    if by_drive:
        return model.simulate(action(), [0.0, 1.0], [0.0, 0.25], output_time_s=OUTPUTS, scene=driven())
    return model.simulate(action(), TIME, FORCE, output_time_s=ROWS / 4096.0, contact_forces=True, inside=True)


def states() -> np.ndarray:
    return np.stack([rest(), rest() + 2.0**-10])


def simulation() -> model.Simulation:
    return model.Simulation(scene(), model.State(0.0, rest(), np.zeros(5)))


def press() -> tuple[np.ndarray, np.ndarray]:
    """Displacements and forces of a press and its release, in whole numbers of 1/4096 m."""
    way = np.concatenate([np.arange(12.0), np.arange(12.0)[::-1]]) / 4096.0
    return way, 1e4 * way + 1e7 * way**2


@cache
def felt_fit() -> model.calibration.FeltFit:
    return model.calibration.fit_felt(model.calibration.split_phases(*press()))


def key_motion() -> model.KeyMotion:
    return model.KeyMotion(np.array([0.0, 32.0]), np.array([[0.0, 0.0, 0.0, 0.0, 1.0, 2.0]]))


CALLS: dict[str, Callable[[], Arguments]] = {
    "model.check_force_table": lambda: TABLE,
    "model.blow_implausibility": lambda: TABLE,
    "model.simulate": lambda: {"action": action(), **TABLE, "output_time_s": OUTPUTS},
    "model.simulate_many": lambda: {
        "action": action(), "trials": {"a": (TIME, FORCE)}, "output_time_s": OUTPUTS, "lanes": False,
    },
    "model.batch.make_jobs": lambda: {
        "action": action(), "trials": {"a": (TIME, FORCE)}, "parameter_sets": {"as given": {}},
        "options": ForceDrivenOptions(output_time_s=OUTPUTS),
    },
    "model.simulate_motion": lambda: {
        "action": action(), "time_s": ROWS / 2048.0, "key_rad": -(ROWS**2) / 2.0**20, "from_rest": True, "members": 0,
        "output_time_s": np.array([0.0, 1.0 / 256.0]), "resolution_rad": 0.0, "jitter_rad": 2.0**-20,
    },
    "model.motion_sensitivities": lambda: {
        "action": action(), "motion": (ROWS / 2048.0, -(ROWS**2) / 2.0**20), "parameters": ["whippen.mass"],
        "options": model.SensitivityOptions(events=False, output_time_s=np.array([0.0, 1.0 / 256.0])),
    },
    "model.sensitivities": lambda: {
        "action": action(), "blow": (TIME, FORCE), "parameters": ["key.mass"],
        "inputs": (np.array([[1.0], [2.0]]), np.array([0.0])),
        "options": model.SensitivityOptions(events=False, output_time_s=OUTPUTS),
    },
    "model.slow_press": lambda: {
        "action": action(), "rest_rad": rest(), "dips_m": np.array([0.0, 2.0**-12]), "speed_m_per_s": 0.25,
        "hold_s": 0.002,
    },
    "model.Scene.check_whole": lambda: {"self": scene(), "angle_rad": states(), "what": "states"},
    "model.KeyMotion.evaluate": lambda: {"self": key_motion(), "time_s": ROWS},
    "model.Simulation.advance": lambda: {
        "self": simulation(), "until": 1.0 / 256.0, "input_time_s": TIME, "input_value": FORCE,
        "output_time_s": OUTPUTS,
    },
    "model.Simulation.plan": lambda: {
        "self": simulation(), "until": 1.0, "input_time_s": TIME, "input_value": FORCE, "output_time_s": TIME,
    },
    "model.Simulation.contact_forces": lambda: {
        "self": simulation(), "angle_rad": states(), "speed_rad_per_s": np.zeros((2, 5)), "memory": np.zeros((2, 0)),
    },
    "model.Simulation.probe_forces": lambda: {
        "self": simulation(), "angle_rad": states(), "speed_rad_per_s": np.zeros((2, 5)),
    },
    "model.null_model.simulate": lambda: {"action": action(), **TABLE, "output_time_s": OUTPUTS},
    "model.drive.drive_readings": lambda: {
        "action": action(), "solution": blow(by_drive=True), "time_s": TIME, "command_v": np.array([0.0, 1.0]),
    },
    "model.measure_touch": lambda: {"action": action(), "forces_n": np.array([20.0, 50.0])},
    f"{TOUCH}.find_check_load": lambda: {"action": action(), **TABLE},
    f"{TOUCH}.hammer_speeds": lambda: {"action": action(), "forces_n": np.array([50.0])},
    f"{TOUCH}.fastest_repetition": lambda: {"action": action(), "peaks_n": np.array([20.0])},
    "model.inside.draw_sheet": lambda: {
        "action": action(), "solution": blow(), "force_n": ROWS, "path": Out("blow.svg"),
    },
    "model.inside.lifts": lambda: {"time_s": ROWS[:3], "depth_m": np.array([1.0, -1.0, 1.0])},
    "model.inside.tensions": lambda: {"time_s": ROWS[:3], "upwards_n": np.array([1.0, -1.0, 1.0])},
    "model.inside.observe": lambda: {
        "scene": scene(), "states": Gives(lambda t: (np.tile(rest(), (len(t), 1)), np.zeros((len(t), 5)))),
        "time_s": np.array([0.0, 2.0**-9]), "start": 0.0, "input_time_s": TIME, "value": FORCE,
    },
    "model.inside.Observer.evaluate": lambda: {
        "self": model.inside.Observer(model.build_scene(action().with_laws({"contact02": "stulov"}))), "q": states(),
        "v": np.zeros((2, 5)), "u": np.array([0.0, 1.0]), "memory": np.array([[0.0], [1.0]]),
    },
    "model.calibration.split_phases": lambda: {
        "displacement_m": press()[0], "force_n": press()[1], "common": {"scale": np.ones((2, 24))},
    },
    "model.calibration.mean_normal_speeds": lambda: {
        "action": action(), "time_s": ROWS, "angle_rad": np.stack([rest() + k / 4096.0 for k in range(24)]),
        "speed_rad_per_s": np.ones((24, 5)),
    },
    "model.calibration.FeltFit.force_n": lambda: {"self": felt_fit(), "x_m": np.array([0.0, 1.0])},
    **{
        f"model.felt.{name}.response": lambda felt=felt: {
            "self": felt, "time_s": ROWS[:3], "depth_m": np.array([0.0, 1.0, 0.0]),
        }
        for name, felt in {
            "FeltLaw": model.felt.HuntCrossley(0.0, 0.0, 1e4, 0.1),
            "HuntCrossley": model.felt.HuntCrossley(0.0, 0.0, 1e4, 0.1),
            "Stulov": model.felt.Stulov(1e4, 1.0, 0.5, 1.0),
            "Hysteresis": model.felt.Hysteresis(0.0, 0.0, 1e4, (0.2,), (0.25,)),
            "NamedLaw": model.felt.NamedLaw("stulov", 0.0, 0.0, 1e4),
        }.items()
    },
    f"{STUDY}.measure_blow": lambda: {"action": action(), "solution": blow(), "force_n": ROWS},
    f"{STUDY}.compare": lambda: {"action": action(), **TABLE, "variants": []},
    **{
        f"model.observables.{name}": lambda: {"action": action(), "angle_rad": states()}
        for name in ("key_front_height_m", "key_front_gap_m", "capstan_gap_m")
    },
    "model.observables.hammer_height_from_angle": lambda: {"action": action(), "hammer_rad": np.array([0.0, 1.0])},
    "model.observables.hammer_height_m": lambda: {
        "action": action(), "angle_rad": states(), "shank_rad": np.zeros(2), "give_m": np.ones((2, 2)),
    },
    "model.observables.head_height_m": lambda: {
        "action": action(), "coordinates": model.BODIES, "rows": states(),
    },
    "model.observables.head_approach_m_per_s": lambda: {
        "action": action(), "coordinates": model.BODIES, "rows": states(), "rates": states(),
    },
    "model.observables.string_normal_component": lambda: {"action": action(), "way": np.ones((3, 2))},
    "model.observables.encoder_rad": lambda: {"angle_rad": ROWS, "lift_m": ROWS, "radius_m": 0.04},
    "model.observables.key_dip_m": lambda: {"action": action(), "angle_rad": states(), "rest_rad": rest()},
}  # fmt: skip
