"""Regulation of an action: seven targets measured as a technician does, seven screws turned to meet them.

``measures`` measures an action, ``screws`` lists the adjustments, ``regulate`` turns them and returns the result: the
four targets at rest together, the three in motion each with its screw (`turn_screw`).
Source: thesis Section 2.3; reasons in docs/explanation/regulation.md.
"""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
