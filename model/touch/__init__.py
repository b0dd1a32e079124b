"""How an action feels: slow press, weights, hammer speed against force, fastest repetition; several side by side.

``weights``, ``hammer_speed`` and ``repetition`` each answer one question about an action; ``feel`` asks all three,
``figure`` draws several actions in one sheet.
"""

from model.touch.feel import Feel, feel
from model.touch.hammer_speed import FORCES, hammer_speeds
from model.touch.repetition import fastest_repetition
from model.touch.weights import Weights, weigh

__all__ = ["FORCES", "Feel", "Weights", "fastest_repetition", "feel", "hammer_speeds", "weigh"]
