"""Names of the files, of their columns, and of parameters as PEtab allows them (letters, digits and underscores)."""

from __future__ import annotations

from validation.conventions import ENCODER_CHANNELS

PROBLEM = "problem.yaml"
PARAMETERS, OBSERVABLES, CONDITIONS, MEASUREMENTS = (
    "parameters.tsv",
    "observables.tsv",
    "conditions.tsv",
    "measurements.tsv",
)
FORCES, TRIALS = "forces.tsv", "trials.tsv"
PETAB_FILES = (PARAMETERS, OBSERVABLES, CONDITIONS, MEASUREMENTS)
OBSERVABLE_IDS = tuple(f"{channel}_rad" for channel in ENCODER_CHANNELS)
TIME, MEASUREMENT, CONDITION = "time", "measurement", "simulationConditionId"
OF_TRIAL = ("session", "number", "preload_n", "u_preload_n", "u_offset_n", "u_gain", "u_delay_s", "noise_n")
SEAL = "trial_sha256"
OF_CHANNEL = ("u_white_rad", "u_steady_rad", "u_scale")
DOT = "__"


def petab_id(name: str) -> str:
    """``contact07.friction.A`` as ``contact07__friction__A``."""
    return name.replace(".", DOT)


def own_name(identifier: str) -> str:
    """The other way round."""
    return identifier.replace(DOT, ".")
