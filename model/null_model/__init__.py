"""The null model: an action with one degree of freedom, the yardstick every comparison is held against.

That one reflected mass passes a force-driven test: Thorin, Boutillon and Lozada, Acta Acustica 100 (2014).
"""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
