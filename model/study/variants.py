"""Simulate one blow on an action and on variants of it, and compare them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.arrays import ArrayRecord
from model.batch.run import simulate_many
from model.errors import InputError, ModelError
from model.files.force_library import RATE_HZ
from model.files.force_table import check_force_table
from model.force_driven import output_times
from model.parameters.action import BODIES, STRING, Action, ActionLike, as_action
from model.parameters.scaling import scale_parameters
from model.scene.selection import choice_of
from model.simulation.solution import Solution
from model.study.blow_measures import BlowMeasures, measure_blow
from model.tolerance import DEFAULT_TOLERANCE

Array = NDArray[np.float64]

AS_GIVEN = "as given"


@dataclass(frozen=True)
class Variant:
    """A name, values to set and factors to scale by; setting comes first."""

    name: str
    values: Mapping[str, float] = field(default_factory=dict)
    factors: Mapping[str, float] = field(default_factory=dict)

    def apply_to(self, action: Action) -> Action:
        """The changed action; ``InputError`` names the variant."""
        try:
            return scale_parameters(action.with_values(self.values), self.factors)
        except InputError as problem:
            raise InputError(f"variant {self.name!r}: {problem}") from None

    of = apply_to  # former names, for one release


@dataclass(frozen=True)
class Study(ArrayRecord):
    """One blow on several variants.

    Attributes
    ----------
    action : name of the action as given
    force_n : (m,) N at the solutions' times
    variants : the first is the action as given
    solutions, measures : one per variant
    """

    action: str
    time_s: Array
    force_n: Array
    variants: tuple[Variant, ...]
    solutions: tuple[Solution, ...]
    measures: tuple[BlowMeasures, ...]

    def __getitem__(self, name: str) -> tuple[Solution, BlowMeasures]:
        k = [v.name for v in self.variants].index(name)
        return self.solutions[k], self.measures[k]

    def difference(self, name: str, body: str, start: float = -np.inf, end: float = np.inf) -> Array:
        """Angle (k,) rad of a body in a variant minus that in the action as given, between two times (s)."""
        at = (self.time_s >= start) & (self.time_s <= end)
        i = BODIES.index(body)
        out: Array = self[name][0].angle_rad[at, i] - self.solutions[0].angle_rad[at, i]
        return out

    def range(self, body: str) -> float:
        """Widest turn of a body in the action as given, rad."""
        return float(np.ptp(self.solutions[0].angle_rad[:, BODIES.index(body)]))

    def rows(self) -> list[dict[str, float | int | bool | str]]:
        """One row per variant: name, its measures (without ``release_s``), and rms and largest difference of the
        hammer's angle, rad, from the action as given."""
        out = []
        for variant, m in zip(self.variants, self.measures, strict=True):
            away = self.difference(variant.name, "hammer")
            rms, largest = float(np.sqrt(np.mean(away**2))), float(np.max(np.abs(away)))
            row = {"variant": variant.name} | asdict(m) | {"hammer_rms_rad": rms, "hammer_largest_rad": largest}
            del row["release_s"]
            out.append(row)
        return out

    def _repr_html_(self) -> str:
        import pandas as pd  # start-up: 0.6 s, only a notebook's display needs it

        return str(pd.DataFrame(self.rows()).to_html(index=False, float_format="{:.4g}".format))


PIANO_VARIANTS = (Variant("damping x 4.5", factors={"damping": 4.5}),)
"""Variants of the thesis's piano blow (4.2.2)."""
FORTE_VARIANTS = (
    Variant("damping / 10", factors={"damping": 0.1}),
    Variant("no damping", factors={"damping": 0.0, f"{STRING}.normal.D": 0.0}),
    Variant("no damping but the string's", factors={"damping": 0.0}),
    Variant("no tangential friction", factors={"friction": 0.0}),
    Variant("no friction at the back check", values={"contact04.friction": 0.0}),
    Variant("no rotational friction", factors={"joint_friction": 0.0}),
)
"""Variants of the thesis's forte blow (4.4)."""


def compare(
    action: ActionLike,
    time_s: ArrayLike,
    force_n: ArrayLike,
    variants: Sequence[Variant],
    tolerance: float = DEFAULT_TOLERANCE,
) -> Study:
    """Simulate a blow (times s, forces N) on an action as given, which comes first, and on its variants, with the
    measures of each; an error in one stops all.

    Parameters
    ----------
    action : parameter set, the first variant
    time_s, force_n : (k,) force table
    variants : changes to the action; names must differ
    tolerance : requested largest error of any angle, rad

    Returns
    -------
    Study
        A solution and the measures of the blow for each variant.

    Raises
    ------
    InputError : two variants of one name, an unknown parameter, a table that cannot be used; or a scene that lacks a
        body or is not driven by a force
    ModelError : a variant that cannot be simulated

    Examples
    --------
    >>> import model
    >>> dry = model.study.Variant("dry", factors={"damping": 0.1})
    >>> study = model.study.compare(model.load_action(), *model.force_table("forte"), [dry])
    >>> [variant.name for variant in study.variants]
    ['as given', 'dry']
    """
    action = as_action(action)
    every = (Variant(AS_GIVEN), *variants)
    names = [v.name for v in every]
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"variant {name!r}: the name is given twice; allowed once ({AS_GIVEN!r} is taken)")
    choice_of(action).need_played_key(action.name)
    times, forces = check_force_table(time_s, force_n)
    actions = [v.apply_to(action) for v in every]
    rows = output_times(float(times[0]), float(times[-1]), RATE_HZ)
    members = simulate_many(
        action,
        {"blow": (times, forces)},
        {v.name: one.changed for v, one in zip(every, actions, strict=True)},
        tolerance=tolerance,
        output_time_s=rows,
        contact_forces=True,
    )
    solutions = []
    for member in members:
        if member.solution is None:
            raise ModelError(f"variant {member.parameters!r}: {member.error}")
        solutions.append(member.solution)
    at = np.interp(rows, times, forces)
    measures = [measure_blow(one, s, at) for one, s in zip(actions, solutions, strict=True)]
    return Study(action.name, rows, at, every, tuple(solutions), tuple(measures))
