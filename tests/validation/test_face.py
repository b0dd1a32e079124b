"""The package's face: every public name is listed, loaded when first used, and refuses what it does not know."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import validation

STUB = Path(validation.__file__).with_name("__init__.pyi")


def names_of_the_stub():
    tree = ast.parse(STUB.read_text(encoding="utf-8"))
    return {alias.name for node in tree.body if isinstance(node, ast.ImportFrom) for alias in node.names}


def test_every_name_of_the_stub_is_listed_and_there():
    names = names_of_the_stub()
    assert names == set(validation.__all__) <= set(dir(validation))
    for name in names:
        assert getattr(validation, name) is not None
    with pytest.raises(AttributeError, match="no_such_name"):
        validation.no_such_name  # noqa: B018


def test_old_names_are_the_same_functions():
    assert not {"compare_session", "compare_sessions"} & set(dir(validation))
    assert validation.InputError is validation.ValidationInputError is validation.errors.InputError


def test_importing_the_package_loads_nothing():
    code = "import sys, validation; print([m for m in ('numpy', 'pandas', 'model', 'rig') if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=STUB.parents[1], check=True)
    assert done.stdout.strip() == "[]"


@pytest.mark.parametrize("name", ["compare", "compare_many", "validate_session", "validate_sessions"])
def test_an_unknown_keyword_is_refused_before_any_work(name, tmp_path):
    first = tmp_path / "nowhere" if name in ("compare", "validate_session") else [tmp_path / "nowhere"]
    with pytest.raises(TypeError, match="tolerence"):
        getattr(validation, name)(first, tolerence=1e-5)
