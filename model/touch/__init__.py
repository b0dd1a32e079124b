"""Touch of an action: touch weights, hammer speed against force, fastest repetition; several actions side by side.

``weights``, ``hammer_speed`` and ``repetition`` each answer one question about an action; ``feel`` collects the three
answers, ``figure`` draws several actions on one sheet. Why: docs/explanation/regulation.md.
"""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
