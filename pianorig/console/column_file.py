"""Column files (CSV or HDF5) that are whole or absent, refused before any work if they could not be written."""

from __future__ import annotations

import tempfile
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import model
from model.parameters.action import LAW
from pianorig.errors import CommandInputError
from rig.atomic_write import replace_when_complete

if TYPE_CHECKING:  # start-up: NumPy and pandas would be loaded by every --help
    import numpy as np
    import pandas as pd
    from numpy.typing import NDArray

ADVICE = "choose another --out"
FIGURE_ENDINGS = (".svg", ".pdf", ".png")


def check_writable(path: Path | None, *endings: str) -> None:
    """CommandInputError, before any work is done, for a path that cannot be written, or that ends in none of
    ``endings`` (none given: any); an existing file may be replaced, None is fine."""
    if path is None:
        return
    if endings and path.suffix not in endings:
        allowed = " or ".join(filter(None, (", ".join(endings[:-1]), endings[-1])))
        raise CommandInputError(f"{path}: ending found {path.suffix!r}, allowed {allowed}")
    folder = path.parent
    if not folder.is_dir():
        raise CommandInputError(f"{path}: folder {folder} does not exist; create it or {ADVICE}")
    if path.is_dir():
        raise CommandInputError(f"{path}: is a folder; --out names a file")
    try:
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as problem:
        raise CommandInputError(f"{path}: cannot be written ({problem.strerror}); {ADVICE}") from None


def make_folder(out: Path | None, parents: bool = False) -> None:
    """Make the folder for results, if one was named, or say why that cannot be."""
    try:
        if out is not None:
            out.mkdir(parents=parents, exist_ok=True)
    except OSError as problem:
        raise CommandInputError(f"{out}: folder cannot be made ({problem.strerror}); {ADVICE}") from None


def _write_csv(path: Path, columns: Mapping[str, NDArray[np.float64]]) -> None:
    with open(path, "w", encoding="utf-8", newline="\n") as file:
        file.write(",".join(columns) + "\n")
        # repr of a float is the shortest text that reads back to the same number
        rows = zip(*(column.tolist() for column in columns.values()), strict=True)
        file.writelines(",".join(map(repr, row)) + "\n" for row in rows)


def run_attributes(
    action: model.Action, choice: model.SceneChoice, scene: str, tolerance: float, method: str
) -> dict[str, Any]:
    """What a file of columns says about the run that it came from, by name: action, changed values, tolerance (rad),
    method, scene (as ``scene`` calls ``choice``), effects."""
    laws = {path: law for path, law in action.structure.items() if path.endswith(f".{LAW}")}
    return {
        "action": action.name,
        "changed": ", ".join(f"{k}={v}" for k, v in {**laws, **action.changed}.items()),
        "tolerance_rad": tolerance,
        "method": method,
        "scene": scene,
        "effects": ", ".join([*choice.effects, *(f"{k}={v}" for k, v in choice.values)]),
    }


def write_columns(
    path: Path,
    columns: Mapping[str, NDArray[np.float64]],
    attributes: Mapping[str, Any] | None = None,
    long_names: Mapping[str, str] | None = None,
) -> None:
    """Write columns (n,) of equal length, by name, to ``path`` (.csv, or .h5 with units and a time scale), replacing a
    file there, whole or not at all.

    ``attributes`` of the file and ``long_names`` of columns go into .h5 only.
    """
    check_writable(path, ".csv", ".h5")
    with replace_when_complete(path) as part:
        if path.suffix == ".csv":
            _write_csv(part, columns)
        else:
            from model.tabular import write_h5  # start-up: NumPy would be loaded by every --help

            write_h5(part, columns, attributes=attributes or {}, long_names=long_names or {})


def write_table(path: Path, table: pd.DataFrame) -> None:
    check_writable(path)
    with replace_when_complete(path) as part:
        table.to_csv(part, index=False)


def read_table(path: Path, advice: str, columns: Iterable[str] = ()) -> pd.DataFrame:
    """Read a CSV file into a table; CommandInputError, one line that ends with ``advice``, where it cannot be read or
    lacks one of ``columns``."""
    import pandas as pd  # start-up: 0.3 s that only a table needs

    try:
        table = pd.read_csv(path)
    except (OSError, ValueError) as problem:
        raise CommandInputError(f"{path}: cannot be read ({problem}); {advice}") from None
    missing = [name for name in columns if name not in table]
    if missing:
        raise CommandInputError(f"{path}: column {missing[0]!r} is missing; {advice}")
    return table


def write_rows(path: Path, rows: list[dict[str, Any]]) -> None:
    """Write rows of equal keys as a CSV table, whole or not at all."""
    import pandas as pd  # start-up: 0.3 s that only a table needs

    write_table(path, pd.DataFrame(rows))
