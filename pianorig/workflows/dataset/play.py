"""One trial of the data set: a specimen of the virtual bench is played, and its sensors are read with their errors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pianorig.workflows.dataset.conditions import RATE_HZ, Condition
from pianorig.workflows.dataset.specimens import SCATTER, Specimen
from rig.simulated import ActionPlant, load_plant
from rig.simulated.backend import DEFAULT_BENCH
from validation.dataset.files import DataTrial

Array = NDArray[np.float64]

NEWTONS_PER_VOLT = 12.0
FILM_HZ = 2000.0
COUNTS = {"key_angle": 327680, "whippen_angle": 327680, "hammer_angle": 163840}
U = {
    "force": 0.05, "motor_command": 1e-3, "key_angle": 6e-6, "whippen_angle": 6e-6, "hammer_angle": 1.2e-5,
    "jack_angle": 1e-4, "repetition_angle": 1e-4, "film_time": 1e-5,
}  # fmt: skip
"""Standard uncertainties that are published."""
FORCE_NOISE_N, FORCE_OFFSET_N, FORCE_GAIN = 0.02, 0.04, 0.002
HUM_N, HUM_HZ = 0.03, 60.0
FAULTS = ("force gain", "hammer sign", "key counts", "film late", "hum", "force drift")
BLOCK = 500


@dataclass(frozen=True)
class Played:
    """A trial as it is published, and what is true of it."""

    trial: DataTrial
    truth: dict[str, Any]


def plant_of(specimen: Specimen) -> ActionPlant:
    """The specimen under the arm of the virtual bench's motor."""
    bench = load_plant(DEFAULT_BENCH, seed=specimen.seed, sample_rate_hz=RATE_HZ)
    action = bench.choice.on(specimen.action())
    return ActionPlant(action, bench.choice, specimen.torque_per_volt_nm, SCATTER, specimen.seed, RATE_HZ)


def play(plant: ActionPlant, number: int, condition: Condition, fault: str, random: np.random.Generator) -> Played:
    """Play one stroke on a plant.

    Parameters
    ----------
    plant : ActionPlant
    number : int
        Of the trial.
    condition : Condition
    fault : str
        One of `FAULTS`, or empty.
    random : Generator
        For how it is played and what the sensors add.
    """
    strength, stretch = (float(np.exp(sd * np.clip(random.standard_normal(), -2, 2))) for sd in (0.05, 0.04))
    volts = condition.force(strength, stretch) / NEWTONS_PER_VOLT
    plant.start_trial(number)
    for first in range(0, volts.size, BLOCK):
        plant.advance(volts[first : first + BLOCK])
    truth = plant.truth()
    late = 1e-5 * float(np.clip(random.standard_normal(), -2, 2))
    film_s = np.arange(0.0, truth.time_s[-1], 1.0 / FILM_HZ)
    relative = truth.film_angles_at(film_s + late)[:, 1:]
    values = {
        "force": _force(truth.time_s, truth.force_n, random),
        "motor_command": volts,
        **{name: _counted(truth.column(name.removesuffix("_angle")), COUNTS[name]) for name in COUNTS},
        **{
            name: relative[:, k] - relative[0, k] + U[name] * random.standard_normal(film_s.size)
            for k, name in enumerate(("jack_angle", "repetition_angle"))
        },
    }
    if fault:
        film_s = plant_fault(fault, truth.time_s, film_s, values)
    trial = DataTrial(truth.time_s, film_s, values, U, {"trial": number, "condition": condition.name})
    return Played(trial, {"strength": strength, "stretch": stretch, "film_late_s": late, "fault": fault})


def _force(time_s: Array, force_n: Array, random: np.random.Generator) -> Array:
    gain, offset, phase = 1.0 + FORCE_GAIN * random.standard_normal(), FORCE_OFFSET_N * random.standard_normal(), 6.28
    hum = HUM_N * np.sin(2.0 * np.pi * HUM_HZ * time_s + phase * random.random())
    return np.asarray(gain * force_n + offset + hum + FORCE_NOISE_N * random.standard_normal(time_s.size))


def _counted(angle_rad: Array, counts: int) -> Array:
    width = 2.0 * np.pi / counts
    return np.asarray(width * np.round((angle_rad - angle_rad[0]) / width))


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
