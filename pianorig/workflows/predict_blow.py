"""The model's prediction of a profile's blow on a bench, for the rig's dry run."""

from __future__ import annotations

import numpy as np

import model
from rig import PredictedBlow, Profile, Rig, RigInputError
from rig.configuration.rig_file import BODIES
from rig.safety.dry_run import Predict

AFTER_S = 0.5  # after the profile: the hammer has fallen back


def predictor(rig: Rig, action: str | model.Action = "hirschkorn2004") -> Predict:
    """Return a function from a motor profile to the predicted force on the key, N, angles and speeds over time, by
    simulating the action (name, path or itself) with the motor arm of the rig file; RigInputError without [arm]."""
    config = rig.config
    name = action if isinstance(action, str) else action.name
    nominal = model.load_action(action) if isinstance(action, str) else action

    def predict(profile: Profile) -> PredictedBlow:
        if config.arm is None:
            raise RigInputError(f"rig {config.name}: the dry run needs the motor arm's data; add [arm] to the rig file")
        arm = {
            "inertia": config.arm.inertia_kg_m2,
            "length": config.arm.length_m,
            "joint_friction": config.arm.friction_nm,
            "spring_stiffness": config.arm.spring_nm_per_rad,
            "preload_n": config.force.preload_n,
            "contact_a": 0.0,
            "contact_b": 0.0,
            "contact_c": config.arm.contact_stiffness_n_per_m,
            "contact_damping": config.arm.contact_damping_s_per_m,
        }
        armed = nominal.with_values({f"motor_arm.{key}": value for key, value in arm.items()}, f"rig {config.name}")
        scene = model.build_scene(armed, model.SceneChoice(effects=("motor_arm",)))
        rest = model.rest_state(armed, scene=scene).angle_rad
        run = model.Simulation(scene, model.State(0.0, rest, np.zeros(scene.size)))
        rate_hz = config.device.sample_rate_hz
        force_n = np.append(profile.sample(rate_hz), np.zeros(int(AFTER_S * rate_hz)))
        edge_s = np.arange(force_n.size) / rate_hz
        torque_nm = force_n * config.arm.length_m
        change = np.concatenate([[True], np.diff(torque_nm) != 0.0])
        angle, speed = run.advance(edge_s[-1], edge_s[change], torque_nm[change], held=True, output_time_s=edge_s)
        body = [model.BODIES.index(name) for name in BODIES]
        return PredictedBlow(edge_s, run.probe_forces(angle, speed)[:, 0], angle[:, body], speed[:, body], name)

    return predict
