"""Trials of the data set as the bench records them: a specimen on the virtual bench, through recorder, device, sensors.

Each specimen stands on a bench of its own (`ActionPlant` behind the virtual NI-DAQmx device), and `rig.record` plays
and records its strokes as it would on hardware: anti-alias filter, group delay, codes, counters. What is published of a
trial is read from its sealed file; faults are planted afterwards.
"""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import rig
from pianorig.workflows.dataset.conditions import RATE_HZ, Condition
from pianorig.workflows.dataset.specimens import SCATTER, Specimen
from rig.configuration.profile import Profile
from rig.simulated import ActionPlant, PlantTruth, build_device, load_plant
from rig.simulated.backend import DEFAULT_BENCH, SimulatedBackend
from rig.simulated.bench.sensors import load_sensors
from validation.dataset.files import DataTrial

Array = NDArray[np.float64]

RIG = "virtual"
FILM_HZ = 2000.0
U = {
    "force": 0.05, "motor_command": 1e-3, "key_angle": 5e-5, "whippen_angle": 5e-5, "hammer_angle": 5e-5,
    "jack_angle": 1e-4, "repetition_angle": 1e-4, "film_time": 1e-5,
}  # fmt: skip
"""Standard uncertainties that are published; the force's without its level, which the rest before the stroke shows."""
BODIES = {"key_angle": "key", "whippen_angle": "whippen", "hammer_angle": "hammer"}
HUM_HZ = 60.0
FAULTS = ("force gain", "hammer sign", "key counts", "film late", "hum", "force drift")


@dataclass(frozen=True)
class Played:
    """A trial as it is published, what is true of it; for the camera the motion as it was, and when it began, s."""

    trial: DataTrial
    truth: dict[str, Any]
    motion: PlantTruth
    start_s: float


class SpecimenBench:
    """A virtual bench with a specimen under the arm of its motor; trials are played one after the other.

    Parameters
    ----------
    specimen : Specimen
    """

    def __init__(self, specimen: Specimen) -> None:
        bench = load_plant(DEFAULT_BENCH, specimen.seed, RATE_HZ, scene=specimen.scene)
        action = bench.choice.on(specimen.action())
        plant = ActionPlant(action, bench.choice, specimen.torque_per_volt_nm, SCATTER, specimen.seed, RATE_HZ)
        self.rig = rig.load_rig(RIG)
        sensors = load_sensors(DEFAULT_BENCH, seed=specimen.seed)
        self.backend = SimulatedBackend(build_device(self.rig.config, plant, sensors))

    def close(self) -> None:
        """Give the virtual device back."""
        self.backend.close()

    def play(self, number: int, condition: Condition, fault: str, random: np.random.Generator) -> Played:
        """Record one stroke.

        Parameters
        ----------
        number : int
            Of the trial.
        condition : Condition
        fault : str
            One of `FAULTS`, or empty.
        random : Generator
            For how it is played and what film and faults add.
        """
        strength, stretch = (float(np.exp(sd * np.clip(random.standard_normal(), -2, 2))) for sd in (0.05, 0.04))
        times, forces = condition.corners(strength, stretch)
        self.backend.continue_after(number - 1)
        with tempfile.TemporaryDirectory() as folder:
            session = rig.record(
                Path(folder) / "session", profile=Profile(condition.name, times, forces), rig_config=self.rig,
                trials=1, backend=self.backend,
            )  # fmt: skip
            data = session.trial(1).read()
        plant = self.backend.plant
        assert isinstance(plant, ActionPlant)
        motion = plant.truth()
        late = 1e-5 * float(np.clip(random.standard_normal(), -2, 2))
        assert data.camera is not None
        film_s = data.camera.frame_time_s
        film_s = film_s[(film_s >= 0.0) & (film_s < min(data.time_s[-1], motion.time_s[-1]) - 1e-3)]
        relative = motion.film_angles_at(film_s + late)[:, 1:]
        angles = dict(zip((one.name for one in data.encoders), data.angle_rad().T, strict=True))
        values = {
            # what a sample shows is one group delay old
            "force": np.interp(data.time_s + data.force_info.group_delay_s, data.time_s, data.force_n),
            "motor_command": data.motor_command_v,
            **{name: angles[body] - angles[body][0] for name, body in BODIES.items()},
            **{
                name: relative[:, k] - relative[0, k] + U[name] * random.standard_normal(film_s.size)
                for k, name in enumerate(("jack_angle", "repetition_angle"))
            },
        }
        published_s = plant_fault(fault, data.time_s, film_s, values) if fault else film_s
        facts = {"trial": number, "condition": condition.name}
        trial = DataTrial(data.time_s, published_s, values, U, facts)
        truth = {"strength": strength, "stretch": stretch, "film_late_s": late, "fault": fault}
        return Played(trial, truth, motion, data.blow_start_s)


def plant_fault(fault: str, time_s: Array, film_s: Array, values: dict[str, Array]) -> Array:
    """Put a fault into the values of a trial; return the film's times, which it may change."""
    if fault == "force gain":
        values["force"] = 1.15 * values["force"]
    elif fault == "hammer sign":
        values["hammer_angle"] = -values["hammer_angle"]
    elif fault == "key counts":
        at = int(np.argmin(values["key_angle"]))
        values["key_angle"] = values["key_angle"] + np.where(np.arange(time_s.size) > at, 0.003, 0.0)
    elif fault == "film late":
        return film_s + 3e-3
    elif fault == "hum":
        values["force"] = values["force"] + 0.8 * np.sin(2.0 * np.pi * HUM_HZ * time_s)
    elif fault == "force drift":
        values["force"] = values["force"] + 1.0 * (time_s - time_s[0])
    return film_s
