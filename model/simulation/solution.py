"""What a simulation returns: times, angles, speeds, contact forces where asked for, and work counters."""

from __future__ import annotations

import html
from dataclasses import dataclass, field, fields
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from model.arrays import ArrayRecord
from model.observables import head_approach_m_per_s, head_height_m, key_dip_m
from model.parameters.action import BODIES, Action
from model.parameters.effects import KEY_LIFT, column
from model.simulation.compliant_joints import CompliantJointMotion
from model.simulation.loads_and_losses import Inside
from model.simulation.string_motion import StringMotion

if TYPE_CHECKING:
    import pandas as pd

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


class Moved:
    """A motion (m,) of bodies, effects and joints that may give, whatever drives it."""

    bodies: tuple[str, ...]
    angle_rad: NDArray[np.float64]
    speed_rad_per_s: NDArray[np.float64]
    string: StringMotion | None
    give: CompliantJointMotion | None

    def hammer_height_m(self, action: Action) -> NDArray[np.float64]:
        """Distance (m,) of the hammer's head from the string, m, with what its shank bends and its joint gives."""
        names, rows, _ = self.all_coordinates()
        return head_height_m(action, names, rows)

    def key_dip_m(self, action: Action) -> NDArray[np.float64]:
        """How far (m,) the key's front has gone down since the first row, m, with what it lifts and its joint gives."""
        names, rows, _ = self.all_coordinates()
        angles = np.repeat(rows[:, [names.index("key")]], len(BODIES), axis=1)
        risen = sum((rows[:, names.index(way)] for way in (KEY_LIFT, "key_pin_y") if way in names), np.zeros(len(rows)))
        return key_dip_m(action, angles) - (risen - risen[:1])

    def hammer_approach_m_per_s(self, action: Action) -> NDArray[np.float64]:
        """Speed (m,) of the hammer's head towards the string, m/s, with what its shank bends and its joint gives."""
        return head_approach_m_per_s(action, *self.all_coordinates())

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
    """Trajectory of a scene.

    Attributes
    ----------
    bodies : (n,) names, order of the columns
    time_s : (m,)
    angle_rad : (m, n) key, whippen and hammer from ground, jack and repetition from the whippen; then what effects
        add: ``key_lift`` in m above the balance rail, ``shank`` the head's angle from the straight shank,
        ``winding`` the charge (C) that has passed, its rate the current (A)
    speed_rad_per_s : (m, n) and its rates
    contacts : names of the contacts in the scene
    contact_normal_n, contact_friction_n : (m, c) N, or None where forces were not asked for
    counters : steps, rejections, right-hand sides, Jacobians, contact evaluations and skips, time at rest (s)
    tolerance : requested largest error of any angle, rad
    energy : where the work went, or None where it was not asked for
    inside : what acts at contacts, joints and bodies, or None where it was not asked for
    string : the string's motion, or None where the scene has the rigid bar
    give : how far joints give and the forces of their bushings, or None where joints are rigid
    error_rad : estimate of the largest error of any angle at the output times, or None where it was not asked for
    """

    bodies: tuple[str, ...]
    time_s: NDArray[np.float64]
    angle_rad: NDArray[np.float64]
    speed_rad_per_s: NDArray[np.float64]
    contacts: tuple[str, ...] = ()
    contact_normal_n: NDArray[np.float64] | None = None
    contact_friction_n: NDArray[np.float64] | None = None
    counters: dict[str, int | float] = field(default_factory=dict)
    tolerance: float = 1e-5
    energy: EnergyAudit | None = None
    inside: Inside | None = None
    error_rad: float | None = None
    string: StringMotion | None = None
    give: CompliantJointMotion | None = None

    @property
    def misses_tolerance(self) -> bool:
        """Whether the estimated error is more than `MISSED` times the tolerance; False where it was not estimated."""
        return self.error_rad is not None and self.error_rad > MISSED * self.tolerance

    def __repr__(self) -> str:
        """Bodies, rows and times, without the arrays."""
        times = f", {self.time_s[0]:g} to {self.time_s[-1]:g} s" if len(self.time_s) else ""
        missed = f", estimated error {self.error_rad:.1e} rad" if self.error_rad is not None else ""
        return f"<Solution of {', '.join(self.bodies)}: {len(self.time_s)} rows{times}{missed}>"

    def _repr_html_(self) -> str:
        """Start, least, largest and last value of each body, for a notebook; degrees."""
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
        """Columns by name, in the order of the command's output file."""
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

    def to_table(self) -> pd.DataFrame:
        """All columns as a pandas table."""
        import pandas as pd  # start-up: 0.6 s, only a table needs it

        return pd.DataFrame(self.columns())
