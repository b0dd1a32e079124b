"""Integration methods of other families, to compare the model's with (docs/explanation/steps.md).

``METHODS.update(COMPARISON)`` makes them known to ``model.simulate(method=...)``; a step loop compiles on first use.
They keep no account of energies and step through rest.
"""

from benchmarks.methods.tableau import ESDIRK4, RADAU5

COMPARISON = {method.name: method for method in (ESDIRK4, RADAU5)}
