"""What the packages give: every name of a stub is there, once, typed; nothing heavy is loaded before it is needed."""

from __future__ import annotations

import ast
import inspect
import subprocess
import sys
from importlib import import_module
from importlib.metadata import version
from pathlib import Path

import pytest

import model

ROOT = Path(__file__).parents[1]
PACKAGES = ("model", "vision", "rig", "validation")
DOORS = sorted(".".join(stub.parent.relative_to(ROOT).parts) for p in PACKAGES for stub in (ROOT / p).rglob("*.pyi"))


@pytest.mark.parametrize("name", DOORS)
def test_every_name_of_a_stub_is_listed_and_is_what_its_module_defines(name: str) -> None:
    door, names = import_module(name), set[str]()
    for node in ast.parse((ROOT / Path(*name.split(".")) / "__init__.pyi").read_text(encoding="utf-8")).body:
        assert isinstance(node, ast.ImportFrom) and node.level == 1, "a stub holds relative imports only"
        for alias in node.names:
            public = alias.asname or alias.name
            names.add(public)
            home = import_module(f"{name}.{node.module}") if node.module else import_module(f"{name}.{alias.name}")
            assert getattr(door, public) is (getattr(home, alias.name) if node.module else home)
    assert names == set(door.__all__) <= set(dir(door))


@pytest.mark.parametrize("name", PACKAGES)
def test_a_package_knows_what_it_has_not_and_names_nothing_twice(name: str) -> None:
    """An error of bad input is ``InputError`` of its package as well."""
    package = import_module(name)
    with pytest.raises(AttributeError, match="no_such_name"):
        package.no_such_name  # noqa: B018
    names: dict[int, list[str]] = {}
    for public in dir(package):
        found = getattr(package, public)
        if (inspect.isfunction(found) or inspect.isclass(found)) and public != "InputError":
            names.setdefault(id(found), []).append(public)
    assert [twice for twice in names.values() if len(twice) > 1] == []
    assert package.InputError is getattr(package, f"{name.capitalize()}InputError")


SESSION = str(ROOT / "sessions" / "example_forte")
IMPORTS = {
    "model": [
        ("dir(model); model.calibration, model.inside, model.study, model.touch, model.regulation",
         "numpy scipy numba pandas matplotlib"),
    ],
    "vision": [
        ("dir(vision)", "numpy numba cv2 pandas scipy vision.errors"),
        ("import vision.errors", "numpy numba cv2"),
        ("from vision import load_bodies, Body, FilmError", "numba cv2 pandas scipy"),
        ("from vision import open_film, TrackResult, write_mraw", "numba cv2 pandas scipy"),
        ("from vision import estimate_offset, FrameFlag, ErrorBudget", "numba cv2 pandas scipy"),
        ("from vision import CameraModel, load_calibration", "numba cv2 pandas scipy"),
        ("from vision import cramer_rao_bound, write_contact_sheet", "numba pandas scipy matplotlib"),
        ("from vision import track", "pandas scipy.optimize matplotlib"),  # the tracker needs the compiled fit
    ],
    "rig": [
        ("rig", "numpy h5py pydantic nidaqmx numba scipy pandas model vision"),
        (f"rig.Session.open({SESSION!r}).trials[0].read()",
         "nidaqmx numba scipy pandas matplotlib model vision rig.simulated"),
    ],
    "validation": [
        ("validation", "numpy pandas model rig"),
        ("validation.compare, validation.compare_many, validation.validate_session, validation.validate_sessions",
         "numpy numba scipy pandas matplotlib h5py"),
    ],
}  # fmt: skip


@pytest.mark.parametrize("package", IMPORTS)
def test_nothing_heavy_is_loaded_before_it_is_needed(package: str) -> None:
    """The lines of a package one after the other, in one new process."""
    lines = [f"import sys, {package}"]
    for line, absent in IMPORTS[package]:
        lines += [line, f"print([{line!r}, *(m for m in {absent.split()!r} if m in sys.modules)])"]
    done = subprocess.run([sys.executable, "-c", "\n".join(lines)], capture_output=True, text=True, check=True)
    assert [ast.literal_eval(line) for line in done.stdout.splitlines()] == [[line] for line, _ in IMPORTS[package]]


def test_the_version_is_that_of_the_distribution() -> None:
    assert model.__version__ == version("piano-action-rig")
