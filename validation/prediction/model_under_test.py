"""The model under test with everything its predictions depend on, and what it predicts for one trial.

Place in the data flow: measurements → here (with `validation.prediction.trial_prediction`) →
`validation.pipeline.compare_session`.
Conventions: each trial's own corrected force drives the model from rest under the trial's declared preload.  Beside it
stand two *rivals*: the null model (one degree of freedom, nothing fitted) under the same force, and the model itself
under the force as recorded.
Failure: a rival that cannot be predicted is left out with a note; the model itself must succeed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from validation.cache.provenance import model_version
from validation.cache.result_cache import Kept
from validation.errors import PredictionError
from validation.events.definitions import Event
from validation.events.detect import find_events
from validation.measurement.force_correction import CorrectedForce
from validation.measurement.geometry import ActionGeometry, geometry_of
from validation.measurement.stroke import Motion, motion_of
from validation.measurement.trial import ENCODER_CHANNELS, Measurement
from validation.prediction.trial_prediction import Prediction, action_sha256, predict_trial

RIVALS = ("null", "raw_force")


@dataclass
class Load:
    """Rest state and geometry of the action under one preload."""

    rest: Any
    geometry: ActionGeometry


@dataclass
class TrialPrediction:
    """What is predicted for one trial: by the model, by its rivals, and the model's events."""

    model: Prediction
    rivals: dict[str, Prediction]
    events: dict[str, Event]
    notes: list[str]


@dataclass
class Predictor:
    """The model under test.

    Parameters
    ----------
    action : model action
    tolerance : float
        Requested largest error of any angle, rad.
    predict, rest_state, geometry, null : callable, optional
        Stand-ins for ``model.simulate``, ``model.rest_state``, `validation.measurement.geometry.geometry_of` and
        ``model.null_model.simulate``.
    rivals : tuple of str
        Some of `RIVALS`.
    session : rig.session.Session, optional
        Where predictions are kept; None keeps none.
    kept : Kept
        Where what is computed from predictions and trials is kept.
    """

    action: Any
    tolerance: float = 1e-5
    predict: Callable[..., Any] | None = None
    rest_state: Callable[..., Any] | None = None
    geometry: Callable[[Any, Any], ActionGeometry] | None = None
    null: Callable[..., Any] | None = None
    rivals: tuple[str, ...] = RIVALS
    session: Any = None
    kept: Kept = field(default_factory=Kept)
    _loads: dict[float, Load] = field(default_factory=dict, init=False, repr=False)

    @cached_property
    def simulate(self) -> Callable[..., Any]:
        """``model.simulate`` or its stand-in."""
        if self.predict is not None:
            return self.predict
        import model

        found: Callable[..., Any] = model.simulate
        return found

    @cached_property
    def simulate_null(self) -> Callable[..., Any]:
        """``model.null_model.simulate`` or its stand-in."""
        if self.null is not None:
            return self.null
        from model import null_model

        return null_model.simulate

    @cached_property
    def action_hash(self) -> str:
        """Hash of the action's values and structure."""
        return action_sha256(self.action)

    @cached_property
    def version(self) -> str:
        """Hash of the predictor's source."""
        return model_version(self.simulate)

    @property
    def identity(self) -> tuple[str, str, float]:
        """What the outcome of a run depends on beside the trial: action, model and tolerance."""
        return self.action_hash, self.version, self.tolerance

    def load(self, preload_n: float) -> Load:
        """Rest and geometry under a preload, found once."""
        if preload_n not in self._loads:
            self._loads[preload_n] = self.load_of(self.action, preload_n)
        return self._loads[preload_n]

    def load_of(self, action: Any, preload_n: float) -> Load:
        """Rest and geometry of any action under a preload."""
        rest_state = self.rest_state
        if rest_state is None:
            import model

            rest_state = model.rest_state
        rest = rest_state(action, force_n=preload_n)
        return Load(rest, (self.geometry or geometry_of)(action, rest.angle_rad))

    def rail_tensions(self, m: Measurement) -> list[Any]:
        """Intervals in which the model's balance rail would have to pull the key down, under this trial's force.

        A look inside costs some eighty times a prediction: asked for one trial, and only when there is a doubt.  A
        stand-in for the model has no inside.
        """
        if self.predict is not None:
            return []
        from model.inside.rail import Tension

        force = m.force
        found = self.kept.of(
            "look inside",
            (self.identity, force.time_s, force.force_n, force.preload_n),
            lambda: [asdict(tension) for tension in self._look_inside(force)],
        )
        return [Tension(**tension) for tension in found]

    def _look_inside(self, force: CorrectedForce) -> list[Any]:
        run = self.simulate(
            self.action,
            force.time_s,
            force.force_n,
            tolerance=self.tolerance,
            initial=self.load(force.preload_n).rest,
            inside=True,
        )
        return list(run.inside.key_tensions())

    def trial(self, m: Measurement) -> TrialPrediction:
        """Predict one trial by the model and its rivals; unchanged inputs are read, not simulated."""
        from model.errors import ModelError

        load = self.load(m.force.preload_n)
        found = self._one(m, load, "model")
        notes = []
        rivals = {}
        for name in self.rivals:
            try:
                rivals[name] = self._one(m, load, name)
            except (ModelError, PredictionError) as error:
                notes.append(f"{name.replace('_', ' ')} not predicted: {error}")
        events = self.events(predicted_motion(found, load.geometry, self.tolerance), m.quiet.stop)
        return TrialPrediction(found, rivals, events, notes)

    def events(self, motion: Motion, quiet_stop: int) -> dict[str, Event]:
        """Events of a trial or of a prediction, found once."""
        found = self.kept.of(
            "events",
            (motion, quiet_stop),
            lambda: [asdict(event) for event in find_events(motion, quiet_stop).values()],
        )
        return {event["name"]: Event(**event) for event in found}

    def _one(self, m: Measurement, load: Load, variant: str) -> Prediction:
        found, failure = predict_trial(
            m,
            self.action,
            load.rest,
            self.simulate_null if variant == "null" else self.simulate,
            tolerance=self.tolerance,
            action_hash=self.action_hash,
            model_version=self.version,
            session=self.session,
            variant=variant,
        )
        self.kept.count("predictions", reused=found.reused, failure=failure)
        return found


def predicted_motion(p: Prediction, geometry: ActionGeometry, tolerance: float) -> Motion:
    """Motion of a prediction for the same event finders; a sample is as uncertain as the tolerance asked for."""
    change = np.column_stack([p.change_rad(name) for name in ENCODER_CHANNELS])
    return motion_of(geometry, p.time_s, change, np.full(3, tolerance), u_zero_rad=np.full(3, tolerance))
