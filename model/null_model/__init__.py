"""The null model: an action with one degree of freedom, the yardstick every comparison is held against.

An action and a force table in, the same `Solution` as from ``model.simulate`` out. It uses the five-body model's own
parameter file and nothing fitted to trials, so that a report can say how much better five bodies are. Key, whippen,
jack and repetition lever move as one (`reduction`); the hammer rides with them, then flies (`time_stepping`). That one
reflected mass passes a force-driven test: Thorin, Boutillon and Lozada, Acta Acustica 100 (2014).
"""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
