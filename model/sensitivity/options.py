"""How sensitivities are computed: the frozen record of options."""

from __future__ import annotations

from dataclasses import dataclass

from model.errors import InputError
from model.simulation.options import SimulationOptions

SMALLEST, LARGEST = 1e-9, 1e-2  # below, rounding decides; above, derivatives lose their second digit


@dataclass(frozen=True)
class SensitivityOptions(SimulationOptions):
    """How to compute sensitivities.

    Attributes
    ----------
    tolerance : requested largest error of any angle of the motion itself, rad
    relative_tolerance : local error of a derivative allowed in a step, of the largest value it has had
    output_time_s : (m,) increasing, within the force table; by default the table's own times
    scene : what takes part, by name or file (`model.scene.selection`); by default what the action says
    method : integration method of the motion (`model.integrators.methods`)
    rest_input : constant input under which the action rests before the blow: N on the key (the motor arm's preload), or
        the motor's torque, N m
    contact_forces : also derivatives of the contacts' normal forces
    events : also derivatives of the events of the blow
    allow_idle : keep parameters whose elements do nothing in this blow, with derivatives of zero, instead of refusing
        them; they are named in `Sensitivities.idle`
    estimate_error : also estimate the relative error, by a second computation at other tolerances; twice the cost
    """

    tolerance: float = 2e-9  # rad: a derivative is no better than the motion it follows
    method: str = "rodas5p"
    relative_tolerance: float = 3e-6  # of a derivative: far below any uncertainty of a parameter
    rest_input: float = 0.0
    contact_forces: bool = False
    events: bool = True
    allow_idle: bool = False
    estimate_error: bool = False

    def __post_init__(self) -> None:
        if not SMALLEST <= self.relative_tolerance <= LARGEST:
            raise InputError(
                f"relative tolerance: found {self.relative_tolerance:g}, allowed {SMALLEST:g} to {LARGEST:g}"
            )
