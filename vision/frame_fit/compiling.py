"""How functions of this folder are compiled and cached.

They call compiled functions of other files, whose changes numba's disk cache does not notice. The digest of all their
sources is closed over by the cached entries (`compiled.fit_bodies`, `walk.walk`), which makes it part of the cache's
key; what lies between is not cached itself. Elements of arrays are copied one by one: whole slices would compile
messages about their shapes, for seconds.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

from numba import njit

from vision import fitting
from vision.bodies import occlusion


def digest_of_sources() -> str:
    """Of all files whose compiled functions are called from here or by those."""
    digest = hashlib.sha256()
    for folder in (Path(__file__).parent, Path(fitting.__file__).parent):
        for path in sorted(folder.rglob("*.py")):
            digest.update(path.read_bytes())
    digest.update(Path(occlusion.__file__).read_bytes())
    return digest.hexdigest()


def uncounted(function: Callable[..., Any]) -> Any:
    """Compile a function that allocates nothing: counting references to the arrays it is given costs time twice."""
    return inner(function, _nrt=False)


def inner(function: Callable[..., Any], **options: bool) -> Any:
    """Compile a function that only compiled code calls, without what Python would need to call it: a third less time.

    From Python it cannot be called.
    """
    compile_with: Any = njit  # its types do not name all options
    return compile_with(nogil=True, no_cpython_wrapper=True, no_cfunc_wrapper=True, **options)(function)
