"""Options of a simulation: the keywords that a caller may give, and the frozen record that travels inside."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypedDict

from numpy.typing import ArrayLike

from model.integrators.methods import DEFAULT_METHOD
from model.parameters.action import Action
from model.scene.selection import SceneChoice, choice_of
from model.tolerance import DEFAULT_TOLERANCE


class SimulationKeywords(TypedDict, total=False):
    """Keywords that every simulation takes; see `SimulationOptions`."""

    tolerance: float
    output_time_s: ArrayLike | None
    scene: SceneChoice | str | Path | None
    method: str


@dataclass(frozen=True)
class SimulationOptions:
    """How to simulate."""

    tolerance: float = DEFAULT_TOLERANCE  # requested largest error of any angle, rad
    output_time_s: ArrayLike | None = None  # (m,) increasing, within the input table; by default the table's own times
    # what takes part and what to give out, by name or file (`model.scene.selection`); by default what the action says
    scene: SceneChoice | str | Path | None = None
    method: str = DEFAULT_METHOD  # integration method by name (`model.integrators.methods`)

    def resolve(self, action: Action) -> tuple[Action, SceneChoice]:
        """The action as its scene has it, and what takes part."""
        choice = choice_of(action, self.scene)
        return choice.apply_to(action), choice


class ForceDrivenKeywords(SimulationKeywords, total=False):
    """Keywords of a simulation under a force table; see `ForceDrivenOptions`."""

    contact_forces: bool
    energy: bool
    inside: bool
    estimate_error: bool


class BatchKeywords(ForceDrivenKeywords, total=False):
    lanes: bool | None


@dataclass(frozen=True)
class ForceDrivenOptions(SimulationOptions):
    """How to simulate under a force table, and what to give out beyond angles and speeds."""

    contact_forces: bool = False  # normal and friction force of each contact
    energy: bool = False  # where the work of the force went (`Solution.energy`)
    inside: bool = False  # what acts at contacts, joints and bodies (`Solution.inside`)
    # the largest error of any angle (`Solution.error_rad`), by a second run at a tenth of the tolerance
    estimate_error: bool = False

    def resolve(self, action: Action) -> tuple[Action, SceneChoice]:
        """The action as its scene has it, and what takes part; outputs are those of the scene and those wanted."""
        action, choice = super().resolve(action)
        wanted = {name for name in ("contact_forces", "energy", "inside") if getattr(self, name)}
        return action, replace(choice, outputs=tuple(sorted({*choice.outputs, *wanted})))


@dataclass(frozen=True)
class BatchOptions(ForceDrivenOptions):
    # advance members side by side; None leaves it to how many there are (`model.batch.lanes.select_lane_jobs`)
    lanes: bool | None = None
