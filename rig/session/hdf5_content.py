"""Arrays and attributes written to an HDF5 file, and the digest over all of them that identifies a trial.

Derived results carry the digest. HDF5's own bookkeeping, such as the attributes of dimension scales, is not in it: it
covers only what is written through :class:`Content`, in the order of names, whatever the order of writing.
"""

from __future__ import annotations

import hashlib
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray


class Content:
    """What was written to one file, as digests."""

    def __init__(self) -> None:
        self._attributes: dict[str, dict[str, str]] = {}
        self._arrays: dict[str, str] = {}

    def describe(self, node: h5py.Group | h5py.Dataset, **attributes: Any) -> None:
        """Write attributes of a group, a dataset or the file."""
        target, hashed = node.attrs, self._attributes.setdefault(_name(node), {})
        for key, value in attributes.items():
            target[key] = value
            hashed[key] = array_sha256(np.asarray(value))

    def dataset(self, group: h5py.Group, name: str, values: NDArray[Any], /, **attributes: Any) -> h5py.Dataset:
        """Write an array with its attributes."""
        dataset = group.create_dataset(name, data=values)
        self._arrays[_name(dataset)] = array_sha256(values)
        self.describe(dataset, **attributes)
        return dataset

    def quantity(
        self, group: h5py.Group, name: str, values: NDArray[Any], units: str, long_name: str, /, **attributes: Any
    ) -> h5py.Dataset:
        """Write an array with its unit, what it is, and the SHA-256 of its bytes."""
        dataset = self.dataset(group, name, values, units=units, long_name=long_name, **attributes)
        self.describe(dataset, sha256=self._arrays[_name(dataset)])
        return dataset

    def growing(
        self,
        group: h5py.Group,
        name: str,
        shape: int | tuple[int, ...],
        dtype: str,
        /,
        *meaning: str,
        **attributes: Any,
    ) -> Growing:
        """Make a quantity whose rows are added part by part; ``meaning``: unit and what it is."""
        units, long_name = meaning
        dataset = group.create_dataset(name, shape, dtype=dtype)
        self.describe(dataset, units=units, long_name=long_name, **attributes)
        return Growing(self, dataset)

    def close(self, dataset: h5py.Dataset, sha256: str) -> None:
        """Take the digest of an array that is complete."""
        self._arrays[_name(dataset)] = sha256
        self.describe(dataset, sha256=sha256)

    def sha256(self) -> str:
        """Return the digest over everything written."""
        digest = hashlib.sha256()
        for name in sorted(self._attributes):  # the file itself, "/", comes first
            digest.update(name.encode() + b"\0")
            for key, hashed in sorted(self._attributes[name].items()):
                digest.update(f"{key}={hashed}\0".encode())
            digest.update(self._arrays.get(name, "").encode())
        return digest.hexdigest()


class Growing:
    """A dataset that is filled row by row; its digest is that of the whole array."""

    def __init__(self, content: Content, dataset: h5py.Dataset) -> None:
        self._content, self.dataset = content, dataset
        self._rows = 0
        self._digest = hashlib.sha256()

    def add(self, values: NDArray[Any]) -> None:
        """Add the next rows."""
        rows = np.ascontiguousarray(values, dtype=self.dataset.dtype)
        if rows.size:
            self.dataset[self._rows : self._rows + rows.shape[0]] = rows
            self._digest.update(rows.tobytes())
        self._rows += values.shape[0]

    def finish(self) -> None:
        """Store the digest; ValueError unless every row was added."""
        if self._rows != self.dataset.shape[0]:
            raise ValueError(f"{self.dataset.name}: {self._rows} rows, expected {self.dataset.shape[0]}")
        self._content.close(self.dataset, self._digest.hexdigest())


def _name(node: h5py.Group | h5py.Dataset) -> str:
    return node.name.lstrip("/") or "/"


def array_sha256(values: NDArray[Any]) -> str:
    """Return the SHA-256 of an array's little-endian bytes in C order; text as UTF-8, one item a line."""
    array = np.ascontiguousarray(values)
    if array.dtype.kind in "OUS":
        text = "\n".join(item.decode() if isinstance(item, bytes) else str(item) for item in array.ravel())
        return hashlib.sha256(text.encode("utf-8")).hexdigest()
    return hashlib.sha256(array.astype(array.dtype.newbyteorder("<")).tobytes()).hexdigest()
