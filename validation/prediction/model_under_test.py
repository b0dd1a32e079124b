"""The model under test: an action, its tolerance, rest state and geometry, and the functions that simulate it.

Conventions: each trial's own corrected force drives the model from rest under the trial's declared preload.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property

import model
from model.errors import ModelError
from model.force_driven import simulate as own_simulate
from model.tolerance import DEFAULT_TOLERANCE
from rig.atomic_write import sha256_of_bytes
from validation.cache.content_hash import code_sha256
from validation.cache.result_store import ResultStore
from validation.conventions import Array
from validation.errors import ValidationInputError
from validation.measurement.geometry import ActionGeometry, geometry_of
from validation.measurement.position_sensors import SensorCalibration, calibration_of, reference_geometry
from validation.measurement.trial import MeasuredTrial

RIVALS = ("null", "raw_force", "unfitted", "polynomial", "fir", "fir_lags")


@dataclass(frozen=True)
class StandIns:
    """Functions that replace the project's model, for other models and for tests; None keeps the project's.

    Parameters
    ----------
    predict : callable
        For ``model.simulate``.
    rest_state : callable
        For ``model.rest_state``.
    geometry : callable
        For `validation.measurement.geometry.geometry_of`.
    """

    predict: Callable[..., model.Solution] | None = None
    rest_state: Callable[..., model.RestState] | None = None
    geometry: Callable[[model.Action, Array], ActionGeometry] | None = None

    @property
    def are_absent(self) -> bool:
        """Whether no function is replaced."""
        return self.predict is None and self.rest_state is None and self.geometry is None


@dataclass(frozen=True)
class Load:
    """Rest state and geometry of the action under one preload."""

    rest: model.RestState
    geometry: ActionGeometry


@dataclass
class ModelUnderTest:
    """The model under test.

    Parameters
    ----------
    action : model.Action
    tolerance : float
        Requested largest error of any angle, rad.
    stand_ins : StandIns
    rivals : tuple of str
        What stands beside the model, some of `RIVALS`: the null model (one degree of freedom, nothing fitted) under the
        same force, the model itself under the force as recorded, the values before an identification, and three
        black boxes (`validation.statistics.rivals`).
    store : ResultStore
        Results of earlier runs.
    """

    action: model.Action
    tolerance: float = DEFAULT_TOLERANCE
    stand_ins: StandIns = StandIns()
    rivals: tuple[str, ...] = RIVALS
    store: ResultStore = field(default_factory=ResultStore)
    _loads: dict[float, Load] = field(default_factory=dict, init=False, repr=False)

    def __post_init__(self) -> None:
        """Refuse a scene that the measured force cannot drive, or in which a measured body is missing."""
        model.choice_of(self.action).need_played_key(self.action.name)

    @cached_property
    def simulate(self) -> Callable[..., model.Solution]:
        return self.stand_ins.predict or model.simulate

    @property
    def own_model(self) -> bool:
        """Whether the project's model simulates, which runs many strokes side by side."""
        return self.simulate is own_simulate

    @cached_property
    def calibration(self) -> SensorCalibration:
        """Errors of position sensors that the action was identified with."""
        return calibration_of(self.action)

    @cached_property
    def action_hash(self) -> str:
        return action_sha256(self.action)

    @cached_property
    def version(self) -> str:
        """Hash of the source of what simulates."""
        return model_version(self.simulate)

    @property
    def identity(self) -> tuple[str, str, float]:
        """Hash inputs of a run apart from the trial: action, model and tolerance."""
        return self.action_hash, self.version, self.tolerance

    def load(self, preload_n: float) -> Load:
        """Rest and geometry under a preload, found once."""
        if preload_n not in self._loads:
            self._loads[preload_n] = self.load_of(self.action, preload_n)
        return self._loads[preload_n]

    def load_of(self, action: model.Action, preload_n: float) -> Load:
        rest = self.rest_of(action, preload_n)
        return Load(rest, (self.stand_ins.geometry or geometry_of)(action, rest.angle_rad))

    def rest_of(self, action: model.Action, preload_n: float, near: model.RestState | None = None) -> model.RestState:
        """Rest of an action; ``near`` is one of a similar action, where the search begins."""
        if self.stand_ins.rest_state is not None:
            return self.stand_ins.rest_state(action, force_n=preload_n)
        return model.rest_state(action, force_n=preload_n, near=near)

    def geometry_of_trial(self, m: MeasuredTrial) -> ActionGeometry:
        """Geometry for the readings of a trial; for position sensors one for all models."""
        return self.geometry_at(m.force.preload_n) if m.sensors is None else reference_geometry()

    def geometry_at(self, preload_n: float) -> ActionGeometry:
        """Geometry of the action at rest under a preload (N); refuses an action that cannot rest under it."""
        try:
            return self.load(preload_n).geometry
        except ModelError as error:
            raise ValidationInputError(
                f"{self.action.name}: the model cannot run from rest under {preload_n:g} N on the key ({error}); "
                "use other values (`overrides`)"
            ) from None


def model_version(predict: Callable[..., model.Solution]) -> str:
    """Hash of the source and libraries of what simulates, so that a changed model never meets an old prediction."""
    if predict.__module__.split(".")[0] == "model":
        return f"model {code_sha256('model')}"
    return f"{predict.__module__}.{getattr(predict, '__qualname__', type(predict).__name__)}"


def action_sha256(action: model.Action) -> str:
    """Hash of all parameter values and of which bodies and shapes they belong to."""
    structure = "\n".join(f"{path}={text}" for path, text in sorted(action.structure.items()))
    return sha256_of_bytes(f"{action.content()}\n{structure}".encode())
