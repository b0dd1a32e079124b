"""Regulation of an action: seven targets measured as a technician does, seven screws turned to meet them.

``measures`` looks at an action, ``screws`` names the adjustments, ``regulate`` turns them, ``action_file`` writes
the result.
Source: thesis Section 2.3; decisions in docs/decisions/model-regulation.md.
"""

from .action_file import write_action
from .measures import TARGETS, Measurement, Target, measure
from .regulate import Regulation, RegulationError, regulate
from .screws import SCREWS, Screw

__all__ = [
    "SCREWS",
    "TARGETS",
    "Measurement",
    "Regulation",
    "RegulationError",
    "Screw",
    "Target",
    "measure",
    "regulate",
    "write_action",
]
