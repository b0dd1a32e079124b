"""An action with calibrated values, each with its standard uncertainty and source."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from model.parameters.action import Action


def with_calibrated(action: Action, values: Mapping[str, tuple[float, float]], source: str) -> Action:
    """Return a copy of ``action`` with measured values.

    Parameters
    ----------
    action : given set
    values : path -> value and standard uncertainty, in the unit of the path
    source : of the values, for the file

    Returns
    -------
    Action

    Raises
    ------
    InputError : a path does not exist or a value lies outside its range

    Examples
    --------
    >>> import model
    >>> measured = {"hammer.mass": (0.0117, 0.0001)}
    >>> mine = model.calibration.with_calibrated(model.load_action(), measured, "weighed, 2026-11-22")
    >>> mine.quantities["hammer.mass"].u
    0.0001
    """
    changed = action.with_values({path: value for path, (value, _) in values.items()}, "calibration")
    quantities = dict(changed.quantities)
    for path, (_, u) in values.items():
        quantities[path] = replace(quantities[path], u=u, basis="measured", source=source)
    return replace(changed, quantities=quantities, changed=dict(action.changed))
