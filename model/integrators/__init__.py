"""Time integration methods, one per file, each a table of coefficients with its order, stability and source.

``rosenbrock`` and ``diagonal`` hold the step loops of the two kinds; ``diagonal`` is loaded only when it is used.
``get_method(name)`` gives one; ``METHODS`` lists them; ``DEFAULT_METHOD`` is the one the benchmark favours.
"""

from .esdirk4 import ESDIRK4
from .rodas4p import RODAS4P
from .rodas5p import RODAS5P
from .tableau import DiagonalTableau, RosenbrockTableau

METHODS: dict[str, RosenbrockTableau | DiagonalTableau] = {m.name: m for m in (RODAS4P, RODAS5P, ESDIRK4)}
DEFAULT_METHOD = "rodas4p"

__all__ = ["DEFAULT_METHOD", "METHODS", "DiagonalTableau", "RosenbrockTableau", "get_method"]


def get_method(name: str) -> RosenbrockTableau | DiagonalTableau:
    """Return the method of that name; raise ``InputError`` that lists the known ones."""
    from model.errors import InputError

    try:
        return METHODS[name]
    except KeyError:
        raise InputError(f"method: found {name!r}, allowed {', '.join(METHODS)}") from None
