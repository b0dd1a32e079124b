"""Numba's disk cache of this package's compiled functions, verified by a SHA-256 at every load.

An entry is its content followed by the SHA-256 of its file name and content; a damaged one counts as absent and is
compiled again, with one warning a process. A compiled function may call those of other files: numba notices changes of
the function's own file only, so that the digest of all files of `SOURCES` is part of the key.

From ``read_entry`` to ``_VerifiedCache`` the lines are those of `model.kernels.disk_cache`, since neither package may
import the other; ``tests/test_disk_caches.py`` holds them equal.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import pickle
import uuid
import warnings
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numba
from numba.core.caching import FunctionCache, IndexDataCacheFile

DIGEST_BYTES = hashlib.sha256().digest_size
SOURCES = ("bodies", "fitting", "frame_fit", "synthetic", "film/source.py", "results/flags.py")
"""Folders and files of this package that hold compiled functions, or constants of theirs."""
_warned: set[str] = set()


@cache
def digest_of_sources() -> str:
    digest = hashlib.sha256()
    for source in SOURCES:
        path = Path(__file__).parent / source
        for file in sorted(path.rglob("*.py")) or [path]:
            digest.update(file.read_bytes())
    return digest.hexdigest()


def read_entry(path: Path) -> bytes | None:
    """Content of a file of the cache; None where there is none, or, with a warning, where it is not as `write_entry`
    wrote it."""
    try:
        data = path.read_bytes()
    except FileNotFoundError:
        return None
    except OSError as error:
        _warn_once("read", path, f"cannot be read ({error.strerror or error}); the code is compiled again")
        return None
    content = data[:-DIGEST_BYTES]
    if data[-DIGEST_BYTES:] != _digest(path, content):
        _warn_once("read", path, "is damaged; the code is compiled again")
        return None
    return content


def write_entry(path: Path, content: bytes) -> None:
    """Write content and its digest to a file of the cache, whole, or leave what was there; a folder that refuses it
    costs a warning."""
    temporary = path.with_name(f"{path.name}.{uuid.uuid4().hex[:16]}.tmp")
    try:
        try:
            with temporary.open("xb") as file:
                file.write(content)
                file.write(_digest(path, content))
                file.flush()
                os.fsync(file.fileno())
            os.replace(temporary, path)
        finally:
            temporary.unlink(missing_ok=True)
    except OSError as error:
        reason = error.strerror or error
        _warn_once("write", path, f"cannot be written ({reason}); the code is compiled at every start")


def _digest(path: Path, content: bytes) -> bytes:
    digest = hashlib.sha256(path.name.encode() + b"\0")
    digest.update(content)
    return digest.digest()


def _warn_once(kind: str, path: Path, reason: str) -> None:
    if kind not in _warned:
        _warned.add(kind)
        warnings.warn(f"cache of compiled code: {path}: {reason}", stacklevel=3)


class _VerifiedFile(IndexDataCacheFile):  # type: ignore[misc]
    """Index and data files of one function as entries of `read_entry`."""

    def __init__(self, cache_path: str, filename_base: str, source_stamp: Any) -> None:
        super().__init__(cache_path, f"{filename_base}.numba{numba.__version__}", source_stamp)

    def load(self, key: Any) -> Any:
        found = super().load(key)
        return found[2] if found is not None and found[:2] == (self._source_stamp, key) else None

    def save(self, key: Any, data: Any) -> None:
        super().save(key, (self._source_stamp, key, data))

    def _load_index(self) -> Any:
        stamp, overloads = self._load_entry(self._index_path) or (None, {})
        return overloads if stamp == self._source_stamp else {}

    def _save_index(self, overloads: Any) -> None:
        write_entry(Path(self._index_path), self._dump((self._source_stamp, overloads)))

    def _load_data(self, name: str) -> Any:
        return self._load_entry(self._data_path(name))

    def _save_data(self, name: str, data: Any) -> None:
        write_entry(Path(self._data_path(name)), self._dump(data))

    def _load_entry(self, path: str) -> Any:
        content = read_entry(Path(path))
        try:
            return None if content is None else pickle.loads(content)
        except Exception:  # names types that another version of this program had
            return None


class _VerifiedCache(FunctionCache):  # type: ignore[misc]
    """Numba's cache of one function, of verified files."""

    def __init__(self, function: Any) -> None:
        super().__init__(function)
        stamp = (self._impl.locator.get_source_stamp(), digest_of_sources())
        self._cache_file = _VerifiedFile(self._cache_path, self._impl.filename_base, stamp)

    def save_overload(self, sig: Any, data: Any) -> None:
        with contextlib.suppress(OSError):  # the folder has gone, or cannot be written any more
            super().save_overload(sig, data)


def cached_njit(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Decorator: compile with numba's ``options`` and cache the machine code on disk, verified at loading.

    Where no folder can be written, it is kept in memory only.
    """

    def compile_function(function: Callable[..., Any]) -> Any:
        compile_with: Any = numba.njit  # its types do not name all options
        dispatcher = compile_with(**options)(function)
        if hasattr(dispatcher, "enable_caching"):  # not so where numba is told to compile nothing
            with contextlib.suppress(RuntimeError):
                dispatcher._cache = _VerifiedCache(function)
        return dispatcher

    return compile_function


def inner_njit(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Decorator: compile a function that only compiled code calls, without what Python needs to call it, which takes a
    third less time.

    With ``_nrt=False``, of a function that allocates nothing, no references to its arrays are counted, which costs time
    twice.
    """
    compile_with: Any = numba.njit
    decorator: Callable[[Callable[..., Any]], Any] = compile_with(
        nogil=True, no_cpython_wrapper=True, no_cfunc_wrapper=True, **options
    )
    return decorator
