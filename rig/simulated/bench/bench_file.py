"""The bench file: TOML tables with the true values of the virtual bench (specimen, motor, sensors, wiring, scatter)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from rig.configuration import toml_file
from rig.errors import RigInputError


def read_bench(path: Path) -> dict[str, Any]:
    """Parse a bench file; raises RigInputError in one line."""
    return toml_file.parse_toml(toml_file.read_text(path), str(path))


def bench_table(bench: dict[str, Any], name: str, where: Path) -> dict[str, Any]:
    """Return a table of a parsed bench file; raises RigInputError when it is missing."""
    table = bench.get(name)
    if not isinstance(table, dict):
        raise RigInputError(f"{where}: [{name}]: missing; the virtual bench needs this table")
    return table
