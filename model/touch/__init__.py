"""How an action feels: slow press, weights, hammer speed against force, fastest repetition; several side by side.

``weights``, ``hammer_speed`` and ``repetition`` each answer one question about an action; ``feel`` asks all three,
``figure`` draws several actions in one sheet.
"""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
