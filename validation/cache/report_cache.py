"""A report whose inputs have not changed is not made again: hashes in, the kept report or nothing out.

Place in the data flow: session folder, action, options and source code → one hash beside the report → `pianorig
validate`.
Conventions: SHA-256 of file contents, never of times.  Inputs are the session's TOML, annotations, trials and tracked
angles, the action's file and changes, the options, the source of every package that shapes the numbers, and the
versions of the libraries.  Films are not: their angles are.
Failure: whatever cannot be read or does not agree counts as changed, and the report is made again.
"""

from __future__ import annotations

import hashlib
import json
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib import metadata
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from validation.errors import InputError

NAME = "report.inputs.json"
SCHEMA = "piano-action-rig report inputs 1"
PACKAGES = ("model", "rig", "validation")
LIBRARIES = ("numpy", "scipy", "pandas", "matplotlib", "numba", "h5py", "jinja2")
SESSION_FILES = ("*.toml", "*.jsonl", "trial_*.h5", "derived/angles/*.h5")
SOURCES = {".py", ".toml", ".j2", ".css", ".js"}


@dataclass(frozen=True)
class KeptReport:
    """A report that can be used as it is."""

    verdict_lines: list[str]
    files: dict[str, Path]
    made_utc: str


def report_folder(sessions: Sequence[Any], out: str | Path | None) -> Path:
    """Where the report goes: the folder asked for, or that of the only session.

    Raises
    ------
    InputError
        Several sessions and no folder.
    """
    if out is not None:
        return Path(out)
    if len(sessions) != 1:
        raise InputError(f"{len(sessions)} sessions: name a folder for their report with --out")
    return Path(getattr(sessions[0], "path", sessions[0]))


def inputs_sha256(sessions: Sequence[Path], actions: Sequence[str], options: Mapping[str, object]) -> str:
    """Hash of everything a report depends on.

    Parameters
    ----------
    sessions : sequence of Path
        Session folders.
    actions : sequence of str
        Built-in names or paths of TOML files.
    options : mapping
        Everything else that was asked for; plain values.
    """
    digest = hashlib.sha256()
    for session in sessions:
        digest.update(f"session {session.name}\0".encode())
        for pattern in SESSION_FILES:
            for file in sorted(session.glob(pattern)):
                _feed(digest, file.relative_to(session).as_posix(), file)
    for action in actions:
        digest.update(f"action {action}\0".encode())
        if Path(action).is_file():
            _feed(digest, "action", Path(action))
    for text in (json.dumps(dict(options), sort_keys=True, default=str), *map(code_sha256, PACKAGES)):
        digest.update(text.encode() + b"\0")
    return digest.hexdigest()


def kept_report(folder: Path, inputs: str) -> KeptReport | None:
    """The report in a folder when it was made from these inputs and none of its files has been touched since."""
    try:
        content = json.loads((folder / NAME).read_text(encoding="utf-8"))
        if content["schema"] != SCHEMA or content["inputs_sha256"] != inputs:
            return None
        files = {str(name): folder / str(name) for name in content["files_sha256"]}
        if any(_sha256(files[name]) != sha for name, sha in content["files_sha256"].items()):
            return None
        return KeptReport([str(line) for line in content["verdict_lines"]], files, str(content["made_utc"]))
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return None


def keep_report(
    folder: Path, inputs: str, files: Mapping[str, Path], verdict_lines: Iterable[str], made_utc: str
) -> str:
    """Write beside a report what it was made from; why it could not be written, or an empty string."""
    from rig.errors import InputError as RigInputError
    from rig.storage.atomic_write import write_text

    content = {
        "schema": SCHEMA,
        "made_utc": made_utc,
        "inputs_sha256": inputs,
        "files_sha256": {name: _sha256(path) for name, path in files.items()},
        "verdict_lines": list(verdict_lines),
    }
    try:
        write_text(folder / NAME, json.dumps(content, indent=1, ensure_ascii=False) + "\n")
    except RigInputError as error:
        return f"report not kept for the next run: {error}"
    return ""


def _sha256(file: Path) -> str:
    return hashlib.sha256(file.read_bytes()).hexdigest()


def _feed(digest: hashlib._Hash, name: str, file: Path) -> None:
    digest.update(name.encode() + b"\0" + hashlib.sha256(file.read_bytes()).digest())


@cache
def code_sha256(package: str, without: str = "") -> str:
    """Hash of the code that computes: a package's source, but for one of its folders, and the libraries' versions."""
    digest = hashlib.sha256()
    for name, file in sources(package):
        if not without or not name.startswith(f"{without}/"):
            _feed(digest, name, file)
    digest.update("\n".join(library_versions()).encode())
    return digest.hexdigest()


def sources(package: str) -> list[tuple[str, Path]]:
    """Every file of a package that shapes what it computes: its place in the package, with slashes, and its path."""
    spec = find_spec(package)
    homes = list(spec.submodule_search_locations or []) if spec is not None else []
    return sorted(
        (file.relative_to(home).as_posix(), file)
        for home in homes
        for file in Path(home).rglob("*")
        if file.suffix in SOURCES and file.is_file()
    )


def library_versions() -> Iterable[str]:
    """Versions of Python and of the libraries that compute, a line each."""
    yield sys.version
    for name in LIBRARIES:
        try:
            yield f"{name} {metadata.version(name)}"
        except metadata.PackageNotFoundError:
            yield f"{name} unknown"
