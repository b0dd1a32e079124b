"""Regulation of an action: seven targets measured as a technician does, seven screws turned to meet them.

``measures`` looks at an action, ``screws`` names the adjustments, ``regulate`` turns them, ``action_file`` writes
the result.
Source: thesis Section 2.3; decisions in docs/decisions/0025-model-regulation.md.
"""

from model.parameters.write_toml import write_action
from model.regulation.measures import TARGETS, Measurement, Target, measure
from model.regulation.regulate import Regulation, RegulationError, regulate
from model.regulation.screws import SCREWS, Screw

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
