"""What a simulation returns: times, angles, speeds, contact forces where asked for, and work counters."""

from __future__ import annotations

import html
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields
from typing import Any, SupportsIndex, overload

import numpy as np
from numpy.typing import NDArray

from model.arrays import ArrayRecord
from model.errors import InputError, did_you_mean
from model.observables import head_approach_m_per_s, head_height_m, key_dip_m
from model.parameters.action import BODIES, Action
from model.parameters.effects import KEY_LIFT, column
from model.simulation.compliant_joints import CompliantJointMotion
from model.simulation.loads_and_losses import Inside
from model.simulation.string_motion import StringMotion
from model.tabular import Tabular
from model.tolerance import DEFAULT_TOLERANCE

MISSED = 10.0  # times the requested tolerance, from which an error counts as a request missed


@dataclass(frozen=True)
class EnergyAudit:
    """Where the work of the input went during a run, J; integrated with the motion."""

    work_in: float
    stored_change: float  # kinetic, potential and elastic
    lost_in_felt: float
    lost_in_contact_friction: float
    lost_in_joint_friction: float
    lost_in_rail: float = 0.0  # felt of the balance rail and friction on its pin
    lost_in_shank: float = 0.0
    lost_in_pins: float = 0.0  # in the bushings of joints that give
    lost_in_string: float = 0.0
    lost_in_drive: float = 0.0  # the motor's winding, or the finger's joint

    @property
    def loss(self) -> float:
        """Sum of all losses, J."""
        return float(sum(getattr(self, item.name) for item in fields(self) if item.name.startswith("lost_in_")))

    lost = loss  # its former name, for one release

    @property
    def residual(self) -> float:
        """Work that is not accounted for, J: an error of the integration, zero for an exact one."""
        return self.work_in - self.stored_change - self.loss


@dataclass(frozen=True)
class ContactForce:
    """Forces (m,) of one contact, N: ``normal_n`` where its surfaces press, ``friction_n`` along them."""

    name: str
    normal_n: NDArray[np.float64]
    friction_n: NDArray[np.float64]


class Contacts(tuple[str, ...]):
    """Names of contacts; ``contacts["back check"]`` or ``contacts["contact04"]`` has the forces of one."""

    _normal_n: NDArray[np.float64] | None  # (m, c)
    _friction_n: NDArray[np.float64] | None
    _titles: Mapping[str, str]  # what a technician calls it -> the name in this tuple

    @classmethod
    def build(
        cls,
        names: Iterable[str],
        action: Action | None,
        normal_n: NDArray[np.float64] | None,
        friction_n: NDArray[np.float64] | None,
    ) -> Contacts:
        """The contacts of a solution, which also answer to their descriptions in ``action``, with normal and friction
        forces (m, c), N, where requested."""
        out, known = cls(names or ()), {} if action is None else action.structure
        out._normal_n, out._friction_n = normal_n, friction_n
        out._titles = {known.get(f"{name}.description", name): name for name in out}
        return out

    @overload
    def __getitem__(self, key: SupportsIndex) -> str: ...
    @overload
    def __getitem__(self, key: slice) -> tuple[str, ...]: ...
    @overload
    def __getitem__(self, key: str) -> ContactForce: ...
    def __getitem__(self, key: Any) -> Any:
        if not isinstance(key, str):
            return super().__getitem__(key)
        if self._normal_n is None or self._friction_n is None:
            raise InputError("contacts: their forces were not computed; give contact_forces=True to model.simulate")
        name = self._titles.get(key, key)
        if name not in self:
            raise InputError(f"contact {key!r}: not in this scene{did_you_mean(key, self._titles)}there are {self!r}")
        k = self.index(name)
        return ContactForce(name, self._normal_n[:, k], self._friction_n[:, k])

    def __repr__(self) -> str:
        names = (t if t == n else f"{t} ({n.removeprefix('contact')})" for t, n in self._titles.items())
        return ", ".join(names) or "none: their forces were not computed"


class Moved(Tabular):
    """A motion (m,) of bodies, effects and joints that may give, whatever drives it."""

    _told, _line = ", model", "--"
    action: Action | None
    bodies: tuple[str, ...]
    angle_rad: NDArray[np.float64]
    speed_rad_per_s: NDArray[np.float64]
    string: StringMotion | None
    give: CompliantJointMotion | None

    @property
    def hammer_height_m(self) -> NDArray[np.float64]:
        """Distance (m,) of the hammer's head from the string, m, with what its shank bends and its joint gives."""
        names, rows, _ = self.all_coordinates()
        return head_height_m(self._known_action(), names, rows)

    @property
    def key_dip_m(self) -> NDArray[np.float64]:
        """How far (m,) the key's front has gone down since the first row, m, with what it lifts and its joint gives."""
        names, rows, _ = self.all_coordinates()
        angles = np.repeat(rows[:, [names.index("key")]], len(BODIES), axis=1)
        risen = sum((rows[:, names.index(way)] for way in (KEY_LIFT, "key_pin_y") if way in names), np.zeros(len(rows)))
        return key_dip_m(self._known_action(), angles) - (risen - risen[:1])

    @property
    def hammer_approach_m_per_s(self) -> NDArray[np.float64]:
        """Speed (m,) of the hammer's head towards the string, m/s, with what its shank bends and its joint gives."""
        return head_approach_m_per_s(self._known_action(), *self.all_coordinates())

    def _known_action(self) -> Action:
        if self.action is None:
            raise InputError("solution: made without its action; give it: dataclasses.replace(solution, action=action)")
        return self.action

    def all_coordinates(self) -> tuple[tuple[str, ...], NDArray[np.float64], NDArray[np.float64]]:
        """Names, values (m, n) and rates (m, n) of all coordinates, with the directions in which joints give."""
        if self.give is None:
            return self.bodies, self.angle_rad, self.speed_rad_per_s
        rows = np.column_stack([self.angle_rad, self.give.way_m])
        rates = np.column_stack([self.speed_rad_per_s, self.give.speed_m_per_s])
        return (*self.bodies, *self.give.directions), rows, rates

    def string_and_joint_columns(self) -> dict[str, NDArray[np.float64]]:
        """Columns by name of what the string and joints that give do."""
        out = {} if self.string is None else {"string_m": self.string.way_m}
        return out if self.give is None else out | self.give.columns()

    whole, remembered = all_coordinates, string_and_joint_columns  # former names, for one release


@dataclass(frozen=True, repr=False)
class Solution(Moved, ArrayRecord):
    """Trajectory of a scene: ``solution["hammer"]`` is one angle, ``solution.contacts["back check"]`` one contact.

    Attributes
    ----------
    bodies : (n,) names, order of the columns
    time_s : (m,)
    angle_rad : (m, n) key, whippen and hammer from ground, jack and repetition from the whippen; then what effects
        add: ``key_lift`` in m above the balance rail, ``shank`` the head's angle from the straight shank,
        ``winding`` the charge (C) that has passed, its rate the current (A)
    speed_rad_per_s : (m, n) and its rates
    contacts : names of the contacts in the scene, where forces were asked for; by name in brackets the forces of one
    contact_normal_n, contact_friction_n : (m, c) N, or None where forces were not asked for
    counters : steps, rejections, right-hand sides, Jacobians, contact evaluations and skips, time at rest (s)
    tolerance : requested largest error of any angle, rad
    energy : where the work went, or None where it was not asked for
    inside : what acts at contacts, joints and bodies, or None where it was not asked for
    string : the string's motion, or None where the scene has the rigid bar
    give : how far joints give and the forces of their bushings, or None where joints are rigid
    error_rad : estimate of the largest error of any angle at the output times, or None where it was not asked for
    action : the parameter set, with the scene's values; None for a solution that was made without one
    """

    bodies: tuple[str, ...]
    time_s: NDArray[np.float64]
    angle_rad: NDArray[np.float64]
    speed_rad_per_s: NDArray[np.float64]
    contacts: Contacts = Contacts.build((), None, None, None)
    contact_normal_n: NDArray[np.float64] | None = None
    contact_friction_n: NDArray[np.float64] | None = None
    counters: dict[str, int | float] = field(default_factory=dict)
    tolerance: float = DEFAULT_TOLERANCE
    energy: EnergyAudit | None = None
    inside: Inside | None = None
    error_rad: float | None = None
    string: StringMotion | None = None
    give: CompliantJointMotion | None = None
    action: Action | None = field(default=None, repr=False, compare=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        named = Contacts.build(self.contacts, self.action, self.contact_normal_n, self.contact_friction_n)
        object.__setattr__(self, "contacts", named)

    @property
    def misses_tolerance(self) -> bool:
        """Whether the estimated error is more than `MISSED` times the tolerance; False where it was not estimated."""
        return self.error_rad is not None and self.error_rad > MISSED * self.tolerance

    def __repr__(self) -> str:
        times = f", {self.time_s[0]:g} to {self.time_s[-1]:g} s" if len(self.time_s) else ""
        missed = f", estimated error {self.error_rad:.1e} rad" if self.error_rad is not None else ""
        return f"<Solution of {', '.join(self.bodies)}: {len(self.time_s)} rows{times}{missed}>"

    def _repr_html_(self) -> str:
        """Start, least, largest and last value of each body, for a notebook; ° (mm for a length)."""
        import pandas as pd  # start-up: 0.6 s, only a notebook's display needs it

        rows = [
            {"body": body, "start": x[0], "least": x.min(), "largest": x.max(), "end": x[-1], "unit": unit}
            for i, body in enumerate(self.bodies if len(self.time_s) else ())
            for x, unit in [
                (np.degrees(self.angle_rad[:, i]), "°")
                if column(body).endswith("_rad")
                else (1e3 * self.angle_rad[:, i], "mm")
            ]
        ]
        return html.escape(repr(self)) + str(pd.DataFrame(rows).to_html(index=False, float_format="{:.3f}".format))

    def columns(self) -> dict[str, NDArray[np.float64]]:
        """Columns of the output file in order: ``time_s``, angles (rad), speeds (rad/s) by body, then, where requested,
        normal and friction force (N) of contacts, string and joints, inside view."""
        out = {"time_s": self.time_s}
        for i, body in enumerate(self.bodies):
            out[column(body)] = self.angle_rad[:, i]
        for i, body in enumerate(self.bodies):
            out[column(body, rate=True)] = self.speed_rad_per_s[:, i]
        if self.contact_normal_n is not None and self.contact_friction_n is not None:
            for i, name in enumerate(self.contacts):
                out[f"{name}_normal_n"] = self.contact_normal_n[:, i]
                out[f"{name}_friction_n"] = self.contact_friction_n[:, i]
        out |= self.string_and_joint_columns()
        if self.inside is not None:
            out |= self.inside.columns()
        return out
