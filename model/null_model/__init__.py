"""The null model: an action with one degree of freedom, the yardstick every comparison is held against.

It uses the same parameter file as the five-body model and nothing fitted to trials, so that a report can say how much
five bodies are better. Key, whippen, jack and repetition lever move as one (`path`); the hammer rides with them, then
flies (`march`). The idea that one reflected mass passes a force-driven test: Thorin, Boutillon and Lozada, Acta
Acustica 100 (2014).
"""

from model.null_model.march import restitution
from model.null_model.path import Reduced, reduce_action
from model.null_model.run import simulate

__all__ = ["Reduced", "reduce_action", "restitution", "simulate"]
