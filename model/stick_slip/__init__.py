"""Friction without a threshold speed: the limit that the smoothed law of eq. 2.10 stands for.

`simulate` marches a blow with set-valued Coulomb friction, `compare` puts it beside the smoothed law at falling
threshold speeds, ``figure`` draws that.
"""

from model.stick_slip.limit import THRESHOLDS, Limit, compare
from model.stick_slip.march import Marched, simulate

__all__ = ["THRESHOLDS", "Limit", "Marched", "compare", "simulate"]
