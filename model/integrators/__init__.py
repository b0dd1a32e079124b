"""Time integration methods, one per file, each a table of coefficients with its order, stability and source.

``get_method(name)`` gives one; ``METHODS`` lists them; ``DEFAULT_METHOD`` is the one the benchmark favours.
"""

from .rodas4p import RODAS4P
from .rodas5p import RODAS5P
from .tableau import RosenbrockTableau

METHODS = {m.name: m for m in (RODAS4P, RODAS5P)}
DEFAULT_METHOD = "rodas4p"

__all__ = ["DEFAULT_METHOD", "METHODS", "RosenbrockTableau", "get_method"]


def get_method(name: str) -> RosenbrockTableau:
    """Return the method of that name; raise ``InputError`` that lists the known ones."""
    from model.errors import InputError

    try:
        return METHODS[name]
    except KeyError:
        raise InputError(f"method: found {name!r}, allowed {', '.join(METHODS)}") from None
