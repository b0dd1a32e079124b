"""Time integration methods, one per file, each a table of coefficients with its order, stability and source.

``rosenbrock``, ``diagonal`` and ``coupled`` hold the step loops of the three kinds; the last two load when used.
``methods`` finds a method by its name.
"""

from model.integrators.methods import DEFAULT_METHOD, METHODS, Tableau, get_method
from model.integrators.tableau import CoupledTableau, DiagonalTableau, RosenbrockTableau

__all__ = [
    "DEFAULT_METHOD",
    "METHODS",
    "CoupledTableau",
    "DiagonalTableau",
    "RosenbrockTableau",
    "Tableau",
    "get_method",
]
