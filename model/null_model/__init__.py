"""The null model: an action with one degree of freedom, the yardstick every comparison is held against.

It uses the same parameter file as the five-body model and nothing fitted to trials, so that a report can say how much
five bodies are better. Key, whippen, jack and repetition lever move as one (`path`); the hammer rides with them, then
flies (`march`). The idea that one reflected mass passes a force-driven test: Thorin, Boutillon and Lozada, Acta
Acustica 100 (2014).
"""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
