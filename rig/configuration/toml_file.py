"""TOML files read, checked against a pydantic model, and written."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping, Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import Any, TypeVar

import tomli_w
from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from rig.atomic_write import translate_os_error
from rig.errors import RigInputError

Model = TypeVar("Model", bound=BaseModel)


def read_text(path: Path) -> str:
    try:
        with translate_os_error(path, "read"):
            return path.read_bytes().decode("utf-8")
    except UnicodeDecodeError as error:
        raise RigInputError(f"{path}: byte {error.start} is not UTF-8 text; save the file as UTF-8") from error


def built_in(folder: Path) -> tuple[str, ...]:
    return tuple(sorted(path.stem for path in folder.glob("*.toml")))


def find_toml(name: str | Path, folder: Path, what: str) -> Path:
    """Path of ``<name>.toml`` in ``folder`` if it is built in there, else of the file ``name`` itself; RigInputError,
    which calls it ``what``, where neither exists."""
    path = folder / f"{name}.toml" if str(name) in built_in(folder) else Path(name)
    if not path.is_file():
        known = built_in(folder)
        near = get_close_matches(str(name), known, n=1)
        hint = f"did you mean {near[0]}? " if near else ""
        raise RigInputError(
            f"{name}: no such {what}; {hint}built in are {', '.join(known)}, or give the path of a TOML file"
        )
    return path


def parse_toml(text: str, where: str) -> dict[str, Any]:
    """Parse TOML text, with or without a byte-order mark; ``where`` names it in the one-line error."""
    try:
        return tomllib.loads(text.removeprefix("\ufeff"))
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise RigInputError(f"{where}: not a TOML file ({str(error).splitlines()[0]})") from error


def refuse_nul(text: str, where: str) -> None:
    if re.search(r"\\(u|U0000)0000", text):
        raise RigInputError(f"{where}: holds the character NUL (\\u0000), which no text may; leave it out")


def check(model: type[Model], data: Mapping[str, Any], where: str) -> Model:
    try:
        return model.model_validate(data)
    except ValidationError as error:
        raise RigInputError(f"{where}: {_describe_validation_error(error)}") from None


def _describe_validation_error(error: ValidationError) -> str:
    """One line for what pydantic found wrong first (an unknown key before a missing one): key, value found, what is
    allowed, and how many more."""
    complaints = error.errors(include_url=False)
    # a misspelt key is unknown and missing at once: the unknown one says where to look
    first = next((c for c in complaints if c["type"] == "extra_forbidden"), complaints[0])
    key = _key(first["loc"])
    if first["type"] == "missing":
        line = f"{key} is missing; add it"
    elif first["type"] == "extra_forbidden":
        lacking = [_key(c["loc"]) for c in complaints if c["type"] == "missing" and c["loc"][:-1] == first["loc"][:-1]]
        meant = "".join(f"; {near} is missing" for near in get_close_matches(key, lacking, 1))
        line = f"unknown key {key} = {_value_text(first['input'])}; correct its spelling or remove it{meant}"
    elif first["type"] == "value_error":
        line = f"{key}: {first['ctx']['error']}" if key else str(first["ctx"]["error"])
    elif branches := _branches(complaints, first):
        line = (
            f"{_key(first['loc'][:-1])} = {_value_text(first['input'])}: {' or '.join(map(_complaint_text, branches))}"
        )
        complaints = [c for c in complaints if c not in branches[1:]]
    else:
        line = f"{key} = {_value_text(first['input'])}: {_complaint_text(first)}"
    if len(complaints) > 1:
        line += f" (and {len(complaints) - 1} more)"
    return " ".join(line.split())


def _branches(complaints: Sequence[ErrorDetails], first: ErrorDetails) -> list[ErrorDetails]:
    """Complaints about one value that may have several types; none where it may have one."""
    same = [c for c in complaints if c["loc"][:-1] == first["loc"][:-1] and c["input"] is first["input"]]
    kinds = [c["loc"][-1] for c in same]
    return same if any(str(kind).startswith("literal[") for kind in kinds) else []


def _complaint_text(complaint: ErrorDetails) -> str:
    return complaint["msg"][:1].lower() + complaint["msg"][1:]


def _key(location: Sequence[int | str]) -> str:
    text = ""
    for part in location:
        text += f"[{part}]" if isinstance(part, int) else f".{part}" if text else part
    return text


def _value_text(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def dump_toml(table: Mapping[str, Any]) -> str:
    """Write nested mappings, lists and scalars as TOML text that :mod:`tomllib` reads back to the same values.

    ``None`` values are left out (TOML has no null).
    """
    return tomli_w.dumps(_writable(table))


def toml_value(value: object) -> str:
    if isinstance(value, Sequence) and not isinstance(value, str):
        return "[" + ", ".join(toml_value(item) for item in value) + "]"
    return dump_toml({"x": value}).strip().removeprefix("x = ")


def _writable(value: Any) -> Any:
    """The value without ``None`` in tables, and with a sign for every lone surrogate, which has no TOML form."""
    if isinstance(value, str):
        return value.encode("utf-8", "replace").decode("utf-8")
    if isinstance(value, Mapping):
        return {_writable(key): _writable(item) for key, item in value.items() if item is not None}
    return [_writable(item) for item in value] if isinstance(value, Sequence) else value
