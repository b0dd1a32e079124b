"""Which single changes of model or force would explain the difference: a set that cannot be told apart, no finding.

Conventions: differences of key, whippen and hammer angles in units of each channel's range, before the release only.
Every cause the toolkit can change alone takes part: gain, level and delay of the force, and each friction, mass,
inertia, damping, stiffness, spring and length of the action. Named are all whose best change takes away nearly as much
as the best one's, and never fewer than three: one trial cannot identify a parameter, and several changes together, or
an effect the model does not have, can look like any of them. Source: Gauss–Newton on one cause at a time;
docs/decisions/0060-validation-no-false-name.md.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass

import numpy as np

import model
from model.errors import ModelError
from validation.conventions import ENCODER_BODIES, Array
from validation.measurement.trial import MeasuredTrial
from validation.prediction.coarse_force import coarse_force
from validation.prediction.joint_draws import drawn_tolerance
from validation.prediction.many_runs import Run, run_many
from validation.prediction.model_under_test import ModelUnderTest

SMALLEST_DIFFERENCE = 4e-3  # of the range, root mean square
FORCE_MAY = 2.0  # standard uncertainties of the force's gain and level that a difference may come from
FORCE_LEAVES = 0.33  # of the squared difference
NEARLY = 0.02  # of the squared difference: what is this close to the best explains it nearly as well
FEWEST = 3
SHORTLISTED = 12
ROUNDS = 4
LEAST_TAKEN = 0.5  # of the squared difference: below, no single change explains it
SCALED = (".friction.A", ".joint_friction.A", ".mass", ".inertia", ".normal.D", ".torque", ".stiffness")
STIFFNESS = ("a", "b", "c")


@dataclass(frozen=True)
class SingleChange:
    """One change that explains a share of the squared difference; ``unit`` 1 means a factor."""

    trial: int
    cause: str
    change: float
    unit: str
    taken_away: float

    @property
    def words(self) -> str:
        """The change for a reader."""
        size = f"× {self.change:.3g}"
        if self.unit == "m":
            size = f"{1e3 * self.change:+.2g} mm"
        elif self.unit == "s":
            size = f"{1e3 * self.change:+.2g} ms"
        elif self.unit == "N":
            size = f"{self.change:+.2g} N"
        return f"{self.cause} {size} ({100 * self.taken_away:.1f} %)"


@dataclass(frozen=True)
class Cause:
    """What can be changed alone: by a factor exp(x) of some parameters, or by x of one length or of the force."""

    name: str
    unit: str
    step: float
    limit: float
    paths: tuple[str, ...] = ()


FORCE_CAUSES = (
    Cause("force gain", "1", 0.02, math.log(1.2)),
    Cause("force level", "N", 0.02, 0.5),
    Cause("force delay", "s", 2e-4, 5e-3),
)


def known_causes(action: model.Action) -> list[Cause]:
    """Everything that is changed alone, the force first."""
    causes = list(FORCE_CAUSES)
    values = {path: q for path, q in sorted(action.quantities.items()) if q.value != 0}
    for path, q in values.items():
        if path.endswith(SCALED):
            causes.append(Cause(path, "1", 0.1, math.log(4.0), (path,)))
        elif path.endswith(".normal.a"):
            stem = path[:-1]
            together = tuple(stem + name for name in STIFFNESS if stem + name in values)
            causes.append(Cause(f"{stem[:-1]} stiffness", "1", 0.1, math.log(4.0), together))
        elif q.unit == "m":
            causes.append(Cause(path, "m", 1e-4, 2e-3, (path,)))
    return causes


def single_changes(tested: ModelUnderTest, m: MeasuredTrial, until_s: float) -> list[SingleChange]:
    """Single changes that explain the difference between model and trial nearly as well as the best of them.

    Parameters
    ----------
    tested : ModelUnderTest
        Known results are reused from its store.
    m : MeasuredTrial
        A trial without faults.
    until_s : float
        End of the differences taken into account: the release, after which they grow of themselves.

    Returns
    -------
    list of SingleChange
        The best first; empty when the difference is small, within what the force's uncertainty may make, or explained
        by no single change.
    """
    force = m.force
    found = tested.store.value(
        "single changes",
        (tested.identity, m.number, force.time_s, force.force_n, force.preload_n, m.time_s, m.change_rad, until_s),
        lambda: [asdict(change) for change in _search(tested, m, until_s)],
    )
    return [SingleChange(**change) for change in found]


def in_words(changes: list[SingleChange]) -> list[str]:
    """One line for the reader; none without changes."""
    if not changes:
        return []
    return [
        f"about the model, not a fault of the session: of the squared difference from trial {changes[0].trial} until "
        f"the release, each of these changes alone would take away the stated share: "
        f"{', '.join(c.words for c in changes)}; the trial cannot tell them apart, and several together, or an effect "
        "the model does not have, may be the cause"
    ]


def _search(tested: ModelUnderTest, m: MeasuredTrial, until_s: float) -> list[SingleChange]:
    residuals = _residuals_of(tested, m, until_s)
    start = None if residuals is None else residuals([(None, 0.0)])[0]
    if residuals is None or start is None or math.sqrt(float(np.mean(start**2))) < SMALLEST_DIFFERENCE:
        return []
    u_force = (math.log1p(m.force.channel.gain_relative_u), m.force.u_level_n)
    by_force = residuals(list(zip(FORCE_CAUSES, u_force, strict=False)))
    if _explained_by_force(start, [moved - start for moved in by_force if moved is not None]):
        return []
    causes = known_causes(tested.action)
    stepped = residuals([(cause, cause.step) for cause in causes])
    share = [0.0 if moved is None else _linear_share(moved - start, start) for moved in stepped]
    likely = np.argsort(share)[::-1][:SHORTLISTED]
    followed = _follow(residuals, [causes[i] for i in likely], [stepped[i] for i in likely], start)
    order = sorted(zip((causes[i] for i in likely), followed, strict=True), key=lambda pair: -pair[1][1])
    best = order[0][1][1]
    if best < LEAST_TAKEN:
        return []
    near = [pair for i, pair in enumerate(order) if i < FEWEST or pair[1][1] > best - NEARLY]
    return [
        SingleChange(m.number, cause.name, math.exp(x) if cause.unit == "1" else x, cause.unit, taken)
        for cause, (x, taken) in near
    ]


Change = tuple[Cause | None, float]
Residuals = Callable[[Sequence[Change]], list[Array | None]]


def _residuals_of(tested: ModelUnderTest, m: MeasuredTrial, until_s: float) -> Residuals | None:
    """The difference model − trial over the range of each channel, as a function of changes; None at rest."""
    force = m.force
    inside = (m.time_s >= force.time_s[0]) & (m.time_s <= min(force.time_s[-1], until_s))
    time, trial = m.time_s[inside], m.change_rad[inside]
    if time.size < 10 or not np.all(np.ptp(trial, axis=0) > 0):
        return None
    extent = np.ptp(trial, axis=0)

    def run_of(change: Change) -> Run | None:
        cause, x = change
        gain, level, delay = 1.0, 0.0, 0.0
        changed: dict[str, float] = {}
        if cause is not None and cause.paths:
            by = {p: tested.action[p] for p in cause.paths}
            changed = {p: v + x if cause.unit == "m" else v * math.exp(x) for p, v in by.items()}
        elif cause is not None:
            gain = math.exp(x) if cause.unit == "1" else 1.0
            level = x if cause.unit == "N" else 0.0
            delay = x if cause.unit == "s" else 0.0
        try:
            action = tested.action.with_values(changed) if changed else tested.action
            rest = tested.rest_of(action, gain * force.preload_n + level)
        except ModelError:
            return None
        driven = np.interp(force.time_s + delay, force.time_s, force.force_n)
        table = coarse_force(force.time_s, gain * driven + level)
        return Run(action, rest, *table, time, drawn_tolerance(tested))

    def residuals(changes: Sequence[Change]) -> list[Array | None]:
        runs = [run_of(change) for change in changes]

        def of(i: int, solution: model.Solution) -> Array:
            run = runs[i]
            assert run is not None
            change = np.asarray(solution.angle_rad, dtype=float) - np.asarray(run.rest.angle_rad)
            return np.asarray((change[:, ENCODER_BODIES] - trial) / extent).ravel()

        return run_many(tested, runs, of)

    return residuals


def _linear_share(moved: Array, start: Array) -> float:
    """Share of the squared difference that the best multiple of one change takes away."""
    return _dot(moved, start) ** 2 / (_dot(moved, moved) * _dot(start, start)) if moved.any() else 0.0


def _dot(a: Array, b: Array) -> float:
    """Inner product without BLAS, whose threads wait for each other longer than this takes."""
    return float(np.sum(a * b))


def _explained_by_force(start: Array, moved: list[Array]) -> bool:
    """Whether gain and level of the force, within their uncertainty, may make most of the squared difference."""
    known = [x for x in moved if x.any()]
    if not known:
        return False
    columns = np.column_stack(known)
    least = np.linalg.lstsq(columns, -start, rcond=None)[0]
    left = start + columns @ np.clip(least, -FORCE_MAY, FORCE_MAY)
    return bool(left @ left < FORCE_LEAVES * (start @ start))


def _follow(
    residuals: Residuals, causes: Sequence[Cause], first: Sequence[Array | None], start: Array
) -> list[tuple[float, float]]:
    """Change of each cause that leaves the smallest difference, and the share of its square taken away.

    All causes go round together, so that their runs are done side by side; ``first`` are their first steps.
    """
    at, here = [0.0] * len(causes), [start] * len(causes)
    moved = dict(enumerate(first))
    for _ in range(ROUNDS):
        new = {}
        for i, there in moved.items():
            if there is not None:
                slope = (there - here[i]) / causes[i].step
                step = -_dot(slope, here[i]) / _dot(slope, slope) if slope.any() else 0.0
                new[i] = min(max(at[i] + step, -causes[i].limit), causes[i].limit)
        found = dict(zip(new, residuals([(causes[i], x) for i, x in new.items()]), strict=True))
        going = []
        for i, there in found.items():
            if there is not None and _dot(there, there) < _dot(here[i], here[i]):
                if abs(new[i] - at[i]) >= 0.1 * causes[i].step:
                    going.append(i)
                at[i], here[i] = new[i], there
        if not going:
            break
        moved = dict(zip(going, residuals([(causes[i], at[i] + causes[i].step) for i in going]), strict=True))
    total = _dot(start, start)
    return [(x, 1 - _dot(r, r) / total) for x, r in zip(at, here, strict=True)]
