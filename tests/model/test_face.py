"""The face of the model: every public name is in the stub, resolves, is listed by ``dir()``, and loads on first use."""

import ast
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

import model

FACES = ("", ".batch", ".calibration", ".inside", ".null_model", ".regulation", ".study", ".touch")


def names_in_stub(package: str) -> dict[str, str]:
    """Public name -> module it comes from, as written in the package's stub."""
    stub = Path(str(import_module(package).__file__)).with_suffix(".pyi")
    found = {}
    for node in ast.parse(stub.read_text(encoding="utf-8")).body:
        assert isinstance(node, ast.ImportFrom) and node.level == 1, "a stub holds relative imports only"
        for alias in node.names:
            assert alias.asname == alias.name, f"{package}: {alias.name} is not exported by its own name"
            found[alias.name] = f"{package}.{node.module}" if node.module else ""
    return found


@pytest.mark.parametrize("package", [f"model{face}" for face in FACES])
def test_every_name_of_the_stub_resolves_and_is_listed(package):
    face = import_module(package)
    names = names_in_stub(package)
    assert sorted(dir(face)) == sorted(names)
    assert face.__all__ == sorted(names)
    for name, home in names.items():
        where = import_module(home) if home else sys.modules[package]
        assert getattr(face, name) is getattr(where, name)


def test_a_misspelt_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="simulat"):
        model.simulat  # noqa: B018


def test_old_names_are_the_same_objects():
    assert model.InputError is model.ModelInputError
    assert model.regulation.write_action is model.write_action


def test_importing_the_face_loads_neither_numpy_nor_a_compiler():
    code = (
        "import sys, model; dir(model); model.calibration, model.inside, model.study, model.touch, model.regulation; "
        "print([m for m in ('numpy', 'scipy', 'numba', 'pandas', 'matplotlib') if m in sys.modules])"
    )
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert out.stdout.strip() == "[]"


def test_the_version_is_that_of_the_distribution():
    from importlib.metadata import version

    assert model.__version__ == version("piano-action-rig")
