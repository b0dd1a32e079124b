"""Touch of an action: touch weights, hammer speed against force, fastest repetition; several actions side by side.

``feel`` presses slowly, strikes and repeats, ``hammer_speed`` gives the speed at the string, ``figure`` draws several
actions on one sheet. Why: docs/explanation/regulation.md.
"""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
