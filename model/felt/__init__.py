"""Laws of felt and what measured presses say of them: the thesis's, Stulov's with memory, one with a history.

In: presses of a felt at several speeds and peak forces. Out: each law's parameters with uncertainty, and which laws the
presses support. ``laws`` follows a law along a press, ``pressing`` the measured curves, ``fit`` one law's
parameters, ``compare`` all laws on presses they were not fitted to. The moving action follows the same laws
(`model.elements.laws`), chosen by ``contact02.law`` and so on.
"""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
