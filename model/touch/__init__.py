"""How an action feels: slow press, weights, hammer speed against force, fastest repetition; several side by side.

``weights``, ``hammer_speed`` and ``repetition`` each answer one question about an action; ``feel`` asks all three,
``figure`` draws several actions in one sheet.
"""

from .feel import Feel, feel
from .hammer_speed import FORCES, hammer_speeds
from .repetition import fastest_repetition
from .weights import Weights, weigh

__all__ = ["FORCES", "Feel", "Weights", "fastest_repetition", "feel", "hammer_speeds", "weigh"]
