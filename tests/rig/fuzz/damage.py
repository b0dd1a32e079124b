"""Damaging input and reading it: what every reader must bear.

The first input is whole, damaged ones follow. A reader answers with an error of one line, or with values that a check
finds right.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from rig import InputError

INPUTS, SEED = int(os.environ.get("FUZZ_INPUTS", "100")), int(os.environ.get("FUZZ_SEED", "52"))
"""Of damaged inputs, a format each: `python -m benchmarks fuzz_readers` asks for more."""


Case = tuple[bytes, Callable[[bytes], Any], Callable[[bytes, Any], None]]
"""A whole input, how it is read, and a check of what was found."""
LONGEST_S = 5.0
TOKENS = [
    b"nan", b"inf", b"-inf", b"1e999", b"-1", b"0", b"1_000", b"0x10", b"99999999999999999999", b"''", b'"', b"[",
    b"]", b"{", b"}", b"=", b",", b";", b"\t", b"\n", b"\0", b"\xff", b"true", b"1979-05-27", b"#", b".", b"e",
    b"\xe2\x88\x92",
]  # fmt: skip


def damaged(whole: bytes, chance: np.random.Generator) -> bytes:
    """A digit changed, or one to four changes: a byte flipped, a stretch lost, doubled or moved, a token put in, the
    end cut off."""
    data = bytearray(whole)
    digits = [at for at, byte in enumerate(data) if 48 <= byte < 58]
    if digits and chance.random() < 0.3:
        data[digits[int(chance.integers(len(digits)))]] = int(chance.integers(48, 58))
        return bytes(data)
    for _ in range(int(chance.integers(1, 5))):
        if not data:
            break
        at = int(chance.integers(0, len(data)))
        end = min(len(data), at + int(chance.integers(1, 40)))
        match int(chance.integers(0, 7)):
            case 0:
                data[at] ^= 1 << int(chance.integers(0, 8))
            case 1:
                del data[at:end]
            case 2:
                data[at:at] = data[at:end]
            case 3:
                part = bytes(data[at:end])
                del data[at:end]
                to = int(chance.integers(0, len(data) + 1))
                data[to:to] = part
            case 4:
                data[at:at] = TOKENS[int(chance.integers(0, len(TOKENS)))]
            case 5:
                data[at:end] = TOKENS[int(chance.integers(0, len(TOKENS)))]
            case _:
                del data[at:]
    return bytes(data)


def survive(whole: bytes, read: Callable[[bytes], Any], check: Callable[[bytes, Any], None], inputs: int) -> int:
    """Read damaged inputs; return how many were refused. The first input is whole."""
    chance, refused = np.random.default_rng(SEED), 0
    check(whole, read(whole))
    for _ in range(inputs):
        data = damaged(whole, chance)
        began = time.process_time()
        try:
            found = read(data)
        except InputError as error:
            assert "\n" not in str(error) and len(str(error)) < 2000
            refused += 1
        else:
            check(data, found)
        assert time.process_time() - began < LONGEST_S, data[:200]
    return refused


def text(data: bytes) -> str:
    """Bytes as the readers of files see them."""
    try:
        return data.decode("utf-8")
    except UnicodeDecodeError as error:
        raise InputError(f"byte {error.start} is not UTF-8") from error


def same_values(plain: Any, model: Any) -> None:
    """Every value a TOML reader finds is the value in the checked settings."""
    for key, value in plain.items():
        names = {field.alias or name: name for name, field in type(model).model_fields.items()}
        found = getattr(model, names[key])
        if isinstance(value, dict) and hasattr(type(found), "model_fields"):
            same_values(value, found)
        elif isinstance(value, list) and value and isinstance(value[0], dict):
            assert len(value) == len(found)
            for one, other in zip(value, found, strict=True):
                same_values(one, other)
        elif isinstance(value, list):
            assert list(found) == value
        elif not isinstance(value, dict) and not hasattr(type(found), "model_fields"):
            assert found == value, (key, value, found)
