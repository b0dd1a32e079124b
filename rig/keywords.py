"""Keywords of a public function: one that it does not have is refused in its name."""

from __future__ import annotations

import difflib
import inspect
from collections.abc import Callable, Iterable, Mapping
from typing import Any, TypeVar

T = TypeVar("T")


def make_options(kind: Callable[..., T], function: str, keywords: Mapping[str, Any], first: Iterable[str] = ()) -> T:
    """The options ``kind`` of a public function; ``TypeError`` in the function's name for one that it has not.

    ``first`` are the names of its other arguments.
    """
    refuse_unknown(function, keywords, [*first, *inspect.signature(kind).parameters])
    return kind(**keywords)


def refuse_unknown(function: str, keywords: Iterable[str], known: Iterable[str]) -> None:
    """Raise ``TypeError`` in the name of a public function for a keyword that it has not."""
    names = list(known)
    if unknown := [name for name in keywords if name not in names]:
        near = difflib.get_close_matches(unknown[0], names, n=1)
        hint = f"; did you mean {near[0]!r}?" if near else f"; allowed {', '.join(names)}"
        raise TypeError(f"{function}() got an unexpected keyword argument {unknown[0]!r}{hint}")
