"""Touch of one action: weights from a slow press, hammer speeds for several forces, fastest repetition; table rows."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.arrays import ArrayRecord, as_numbers
from model.parameters.action import Action
from model.touch.hammer_speed import FORCES, hammer_speeds
from model.touch.repetition import fastest_repetition
from model.touch.weights import Weights, weigh


@dataclass(frozen=True)
class Feel(ArrayRecord):
    """Touch of one action.

    Attributes
    ----------
    name : of the action
    weights : from a slow press and release
    blow_n, hammer_m_per_s : (k,) force of the blow and speed of the hammer at the string, NaN where it does not reach
    it
    repetition_hz : fastest repetition, NaN where it follows no rate
    gravity : m/s^2, to express weights in grams
    """

    name: str
    weights: Weights
    blow_n: NDArray[np.float64]
    hammer_m_per_s: NDArray[np.float64]
    repetition_hz: float
    gravity: float

    def rows(self) -> dict[str, float]:
        """Everything but the curve, by name and unit, in the order of the table."""
        w = self.weights
        out = {"key dip, mm": 1e3 * w.dip_m}
        for name, force in (
            ("down weight", w.down_n),
            ("up weight", w.up_n),
            ("friction weight", w.friction_n),
            ("let-off peak", w.let_off_n),
        ):
            out[f"{name}, N"] = force
            out[f"{name}, g"] = 1e3 * force / self.gravity
        for force, speed in zip(self.blow_n, self.hammer_m_per_s, strict=True):
            out[f"hammer at {force:g} N, m/s"] = float(speed)
        out["fastest repetition, 1/s"] = self.repetition_hz
        return out

    def _repr_html_(self) -> str:
        """The rows as a table, for a notebook."""
        import pandas as pd  # start-up: 0.6 s, only a notebook's display needs it

        return str(pd.DataFrame({self.name: self.rows()}).to_html(float_format="{:.3g}".format))


def feel(
    action: Action,
    forces_n: ArrayLike = FORCES,
    name: str | None = None,
    progress: Callable[[str], None] | None = None,
) -> Feel:
    """Measure the touch of an action: a slow press, blows at each force, ever faster repetition.

    Parameters
    ----------
    action : parameter set
    forces_n : forces of the blows, N
    name : what to call it, by default the name of the set
    progress : called with a short text at each step

    Returns
    -------
    Feel
        Weights, N, hammer speeds, m/s, and repetition, 1/s; `Feel.rows` names them all with units.

    Raises
    ------
    InputError : the key has no dip
    StaticsError, IntegrationError : the action has no rest state or cannot be pressed

    Examples
    --------
    >>> import model
    >>> touch = model.touch.feel(model.load_action("hirschkorn2004-regulated"), forces_n=[5.0])
    >>> print(f"{touch.weights.down_n:.2f} N down, {touch.repetition_hz:.1f} blows a second")
    0.44 N down, 12.3 blows a second
    """
    forces, report = as_numbers(forces_n, "forces of the blows", 1), progress or (lambda _: None)
    report("slow press")
    weights = weigh(action)
    report("blows")
    speeds = hammer_speeds(action, forces)
    report("repetition")
    return Feel(
        name=action.name if name is None else name,
        weights=weights,
        blow_n=forces,
        hammer_m_per_s=speeds,
        repetition_hz=fastest_repetition(action),
        gravity=action["gravity.g"],
    )
