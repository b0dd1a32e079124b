"""Sensitivities: derivatives of a blow with respect to the parameters of an action, and what they say.

An action, a force table and names of parameters in; `Sensitivities` out. `parameter_names` finds what a name stands
for, `tangents` integrates the motion and its derivatives (`model.integrators.tangents`), `events` differentiates what
happens in a blow. Why: docs/explanation/sensitivities.md.
"""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
