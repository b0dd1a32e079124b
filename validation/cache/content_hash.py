"""The one rule by which results are found again: a SHA-256 of their kind, the code that computes them, and the inputs.

Hashes are of contents (numbers, text, arrays, bytes of files), never of names or times of files: a session that was
moved, renamed or touched finds its results, one with an altered sample does not.
"""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Iterable, Iterator
from dataclasses import fields, is_dataclass
from functools import cache
from importlib import metadata
from importlib.util import find_spec
from numbers import Integral, Real
from pathlib import Path

from rig.atomic_write import sha256_of_file

LIBRARIES = ("numpy", "scipy", "pandas", "matplotlib", "numba", "h5py", "jinja2")
SOURCES = {".py", ".toml", ".json", ".j2", ".css", ".js"}


def result_key(kind: str, code: object, inputs: object) -> str:
    """Key under which a result is stored: SHA-256 of its kind, of the code that computes it and of its inputs.

    Parameters
    ----------
    kind : what is computed; results of two kinds never stand for each other
    code : str, or tuple of them, hash of the code that computes it, see `code_sha256`
    inputs : arrays, numbers, text, and tuples, lists, dicts and dataclasses of them, everything else the result depends
        on
    """
    return sha256_of((kind, code, inputs))


def sha256_of(value: object) -> str:
    """Hash of plain values, arrays and dataclasses, by type and content."""
    digest = hashlib.sha256()
    for part in _parts(value):
        digest.update(part)
    return digest.hexdigest()


def _parts(value: object) -> Iterator[bytes]:
    """Yield the bytes that identify a value, with its type and length, for hashing; arrays, records and containers
    included."""
    if type(value) is float:  # most of what is hashed: parameters of draws by the ten thousand
        yield f"float {value.hex()} ".encode()
    elif isinstance(value, str):
        yield f"text {len(value)} {value}".encode()
    elif value is None or isinstance(value, bool):
        yield f"{value} ".encode()
    elif isinstance(value, Integral):
        yield f"int {value} ".encode()
    elif isinstance(value, Real):
        yield f"float {float(value).hex()} ".encode()
    elif isinstance(value, tuple | list):
        yield f"list {len(value)} ".encode()
        for item in value:
            yield from _parts(item)
    elif isinstance(value, dict):
        yield f"dict {len(value)} ".encode()
        if all(type(item) is float for item in value.values()) and all(type(name) is str for name in value):
            yield "".join(f"text {len(name)} {name}float {x.hex()} " for name, x in value.items()).encode()
            return
        for name, item in value.items():
            yield from _parts(name)
            yield from _parts(item)
    elif is_dataclass(value) and not isinstance(value, type):
        yield f"{type(value).__qualname__} ".encode()
        for field in fields(value):
            yield from _parts(getattr(value, field.name))
    else:
        yield from _array_parts(value)


def _array_parts(value: object) -> Iterator[bytes]:
    """Bytes to be hashed of a numeric NumPy array (dtype, shape, content) or a NumPy Boolean; else raise TypeError."""
    # start-up: numpy costs 0.1 s, and an unchanged report, which is found by hashes alone, holds no arrays
    import numpy as np

    if isinstance(value, np.bool_):
        yield f"{value} ".encode()
    elif isinstance(value, np.ndarray) and value.dtype.kind in "biuf":
        yield f"array {value.dtype.str} {value.shape} ".encode()
        yield np.ascontiguousarray(value).tobytes()
    else:
        raise TypeError(f"{value!r} is a {type(value).__name__}: its content cannot be hashed")


@cache
def code_sha256(package: str, without: str = "") -> str:
    """Hash of a package's source, except one of its folders, and of the versions of the libraries that compute."""
    files = [
        (name, sha256_of_file(file))
        for name, file in sources(package)
        if not (without and name.startswith(f"{without}/"))
    ]
    return sha256_of((files, list(library_versions())))


def sources(package: str) -> list[tuple[str, Path]]:
    """Files of a package that shape what it computes: path within the package, with slashes, and full path."""
    spec = find_spec(package)
    homes = list(spec.submodule_search_locations or []) if spec is not None else []
    return sorted(
        (file.relative_to(home).as_posix(), file)
        for home in homes
        for file in Path(home).rglob("*")
        if file.suffix in SOURCES and file.is_file()
    )


def library_versions() -> Iterable[str]:
    yield sys.version
    for name in LIBRARIES:
        try:
            yield f"{name} {metadata.version(name)}"
        except metadata.PackageNotFoundError:
            yield f"{name} unknown"
