"""Integration methods by name: ``get_method(name)`` gives one, ``METHODS`` lists them.

``DEFAULT_METHOD`` is the one the benchmark favours (docs/decisions/0032-model-methods.md).
"""

from model.errors import InputError
from model.integrators.esdirk4 import ESDIRK4
from model.integrators.radau5 import RADAU5
from model.integrators.rodas4p import RODAS4P
from model.integrators.rodas5p import RODAS5P
from model.integrators.tableau import CoupledTableau, DiagonalTableau, RosenbrockTableau

Tableau = RosenbrockTableau | DiagonalTableau | CoupledTableau

METHODS: dict[str, Tableau] = {m.name: m for m in (RODAS4P, RODAS5P, ESDIRK4, RADAU5)}
DEFAULT_METHOD = "rodas4p"


def get_method(name: str) -> Tableau:
    """Return the method of that name; raise ``InputError`` that lists the known ones."""
    try:
        return METHODS[name]
    except KeyError:
        raise InputError(f"method: found {name!r}, allowed {', '.join(METHODS)}") from None
