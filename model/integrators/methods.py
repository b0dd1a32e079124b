"""Integration methods by name: ``get_method(name)`` gives one, ``METHODS`` lists them.

Why these two, and which is the default: docs/decisions/0032-model-methods.md. Benchmarks add others to compare with.
"""

from model.errors import InputError
from model.integrators.rodas4p import RODAS4P
from model.integrators.rodas5p import RODAS5P
from model.integrators.tableau import RosenbrockTableau

METHODS: dict[str, RosenbrockTableau] = {method.name: method for method in (RODAS4P, RODAS5P)}
DEFAULT_METHOD = RODAS4P.name


def get_method(name: str) -> RosenbrockTableau:
    """Return the method of that name; raise ``InputError`` that lists the known ones."""
    try:
        return METHODS[name]
    except KeyError:
        raise InputError(f"method: found {name!r}, allowed {', '.join(METHODS)}") from None
