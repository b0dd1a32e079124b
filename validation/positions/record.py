"""The identified set as a file beside a session: parameters, covariance, bands, and which strokes they came from."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from rig.storage.atomic_write import write_text
from validation.errors import ValidationInputError
from validation.positions.band import Calibration
from validation.positions.identify import Fit
from validation.positions.measured import Stroke
from validation.positions.parameters import NAMES, SENSORS

SCHEMA = "piano-action-rig identified positions 2"
FILE = "identified.json"
MODELS = ("regulated", "null", "identified")


@dataclass(frozen=True)
class Identified:
    """An identified set.

    Attributes
    ----------
    action : str
        Name or path of the action whose parameters were changed.
    session : str
        Where it was identified.
    seals : dict of str
        SHA-256 of the strokes it was fitted to, by trial number.
    sensors : dict of str
        Where the key's and hammer's calibrated points are and where the sensors look: it holds for these only.
    names, null_names : tuple of str
    z, covariance, null_z, null_covariance : lists
        In standard deviations of the priors.
    misfit : dict of str
        Before and after.
    left_out : dict
        Parameters without each of the fitted strokes, from which the bands come.
    bands : dict of str to Calibration
        For each model how its band was chosen and calibrated.
    release : dict
        RMS of the hammer in the release, rulers, of the fitted strokes: with which group of parameters left nominal,
        and with which group alone identified.
    """

    action: str
    session: str
    seals: dict[str, str]
    sensors: dict[str, str]
    names: tuple[str, ...]
    z: list[float]
    covariance: list[list[float]]
    null_names: tuple[str, ...]
    null_z: list[float]
    null_covariance: list[list[float]]
    misfit: dict[str, float]
    bands: dict[str, Calibration]
    left_out: dict[str, dict[str, list[float]]] = field(default_factory=dict)
    release: dict[str, dict[str, float]] = field(default_factory=dict)

    def fit(self) -> Fit:
        """The full model's parameters."""
        return Fit(np.array(self.z), np.array(self.covariance), self.misfit["before"], self.misfit["after"], 0)

    def null_fit(self) -> Fit:
        """The null model's."""
        return Fit(np.array(self.null_z), np.array(self.null_covariance), 0.0, 0.0, 0)

    def check(self, strokes: tuple[Stroke, ...], where: str) -> None:
        """Refuse strokes measured by other sensors."""
        for stroke in strokes:
            found = sensors_of(stroke)
            for name, place in self.sensors.items():
                if found.get(name) != place:
                    raise ValidationInputError(
                        f"{where}: trial {stroke.number}: {name} is {found.get(name)!r}, the identified set holds for "
                        f"{place!r}; identify a set on this session, or leave --identified out"
                    )


def sensors_of(stroke: Stroke) -> dict[str, str]:
    """Places of the sensors and of the calibrated points, as text."""
    out = {}
    for one in (stroke.key, stroke.hammer):
        ruler = one.position.ruler
        out[f"{ruler.body} sensor"] = ruler.sensor_at
        out[f"{ruler.body} calibrated point"] = f"{ruler.calibrated_at}, {1e3 * one.travel_m:.2f} mm"
    return out


def write_identified(path: Path, identified: Identified) -> None:
    """Write the set as JSON."""
    plain = {"schema": SCHEMA, **asdict(identified)}
    write_text(path, json.dumps(plain, indent=1) + "\n")


def read_identified(path: Path) -> Identified:
    """Read a set from a file, or from the session folder that holds it.

    Raises
    ------
    ValidationInputError
        It is missing, another kind of file, or has other parameters.
    """
    file = path / FILE if path.is_dir() else path
    try:
        plain: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
    except OSError as error:
        raise ValidationInputError(f"{file}: cannot be read ({error.strerror}); name a file or session") from None
    except ValueError as error:
        raise ValidationInputError(f"{file}: not JSON ({error}); name an {FILE}") from None
    if not isinstance(plain, dict) or plain.pop("schema", None) != SCHEMA:
        raise ValidationInputError(f"{file}: not an identified set, its schema must be {SCHEMA!r}")
    try:
        bands = {name: Calibration(**plain["bands"][name]) for name in MODELS}
        names = {key: tuple(plain[key]) for key in ("names", "null_names")}
        found = Identified(**{**plain, **names, "bands": bands})
    except (TypeError, KeyError) as error:
        raise ValidationInputError(f"{file}: a field is missing or unknown ({error}); identify it again") from None
    if found.names != NAMES or found.null_names != NAMES[: len(SENSORS)]:
        raise ValidationInputError(f"{file}: its parameters are not those of this version; identify it again")
    return found
