"""What a computation of sensitivities returns: a blow and its derivatives with respect to parameters."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from model.arrays import ArrayRecord
from model.errors import InputError
from model.tabular import Tabular, axes_or_new

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False, repr=False)
class Sensitivities(Tabular, ArrayRecord):
    """A blow and its derivatives; the last axis of every derivative is the parameters', (P,).

    Attributes
    ----------
    parameters : (P,) names as they were given
    values : (P,) SI units; 1 for a factor on a law or group
    units : (P,) of the values, "1" for a factor
    uncertainties : (P,) declared standard uncertainty, same unit; NaN for a factor
    time_s : (T,)
    angle_names : (n,) coordinates: bodies, then what effects add
    angles_rad, speeds : (T, n) rad and rad/s (a lift in m and m/s)
    d_angles, d_speeds : (T, n, P) per SI unit of the parameter
    rest_rad : (n,) where the blow starts
    d_rest : (n, P) derivatives of the rest state, with which ``d_angles`` begins
    contact_names : (c,)
    contact_forces, d_contact_forces : (T, c) and (T, c, P) normal forces, N; None where they were not asked for
    force_n, d_force : (T,) and (T, P) force at the key front under a prescribed motion, N; None for a blow by a force
    events : name -> value, s, m or m/s as the name ends; NaN where it does not happen
    d_events : name -> (P,)
    absent_events : name -> why an event has no value
    idle : parameters whose elements do nothing in this blow; their derivatives are zero
    at_kink : contacts that only just touch or only just do not, at rest: derivatives hold on that side alone
    counters : steps and rejections of the motion and of its derivatives, kinks, right-hand sides
    tolerance, relative_tolerance : as asked for
    estimated_error : largest relative error of a derivative of an angle, of its largest value; NaN where not estimated
    """

    parameters: tuple[str, ...]
    values: Array
    units: tuple[str, ...]
    uncertainties: Array
    time_s: Array
    angle_names: tuple[str, ...]
    angles_rad: Array
    speeds: Array
    d_angles: Array
    d_speeds: Array
    rest_rad: Array
    d_rest: Array
    contact_names: tuple[str, ...] = ()
    contact_forces: Array | None = None
    d_contact_forces: Array | None = None
    force_n: Array | None = None
    d_force: Array | None = None
    events: Mapping[str, float] = field(default_factory=dict)
    d_events: Mapping[str, Array] = field(default_factory=dict)
    absent_events: Mapping[str, str] = field(default_factory=dict)
    idle: tuple[str, ...] = ()
    at_kink: tuple[str, ...] = ()
    counters: Mapping[str, int | float] = field(default_factory=dict)
    tolerance: float = 0.0
    relative_tolerance: float = 0.0
    estimated_error: float = float("nan")

    def __repr__(self) -> str:
        names = ", ".join(self.parameters[:3]) + (", …" if len(self.parameters) > 3 else "")
        times = f"{self.time_s[0]:g} to {self.time_s[-1]:g} s" if len(self.time_s) else "no times"
        return f"<Sensitivities to {len(self.parameters)} parameters ({names}): {len(self.time_s)} rows, {times}>"

    def columns(self) -> dict[str, Any]:
        """One row for each parameter: name, value, unit, u, then the derivative of each event, SI per unit of it."""
        events = {f"d_{name}": self.d_events[name] for name in self.events}
        named = {"parameter": list(self.parameters), "value": self.values, "unit": list(self.units)}
        return {**named, "u": self.uncertainties, **events}

    def plot(self, *bodies: str, ax: Axes | None = None, **style: Any) -> Axes:
        """Draw into ``ax``, or a new figure, how far the angle of each of ``bodies`` (None given: hammer, or the last)
        moves, degrees, over time, where each parameter is one percent larger; return the axes.

        Parameters
        ----------
        bodies : by default the hammer, or the last of the scene
        ax : matplotlib axes; by default those of a new figure
        style : what matplotlib's ``plot`` takes
        """
        drawn = axes_or_new(ax)
        for body in bodies or ("hammer" if "hammer" in self.angle_names else self.angle_names[-1],):
            if body not in self.angle_names:
                raise InputError(f"Sensitivities: no body {body!r}; there are {', '.join(self.angle_names)}")
            moved = self.d_angles[:, self.angle_names.index(body)] * self.values / 100
            for k, name in enumerate(self.parameters):
                drawn.plot(self.time_s, np.degrees(moved[:, k]), **{"label": f"{body}: 1 % of {name}", **style})
        drawn.set(xlabel="time, s", ylabel="change of the angle, °")
        drawn.legend(fontsize="small")
        return drawn
