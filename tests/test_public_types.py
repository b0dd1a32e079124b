"""A user's type checker sees every public name of the installed wheel, and finds a misspelt keyword."""

from __future__ import annotations

import ast
import importlib
import inspect
import os
import re
import subprocess
import sys
import venv
import zipfile
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = ("model", "vision", "rig", "validation", "pianorig")
UNTYPED = "class DataFrame: ...\nclass Series: ...\n"
"""pandas ships no types; with these its names are not taken for `Any`."""
NOT_READ = "[mypy]\n[mypy-numba.*,IPython.*,coverage.*,rich.*,markdown_it.*,jinja2.*,cv2.*]\nfollow_imports = skip\n"
"""Typed packages of which no public name speaks: a third of the checker's time."""
MISSPELT = """
import numpy as np
import model, rig, validation, vision
times, force = np.zeros(2), np.zeros(2)
model.simulate(model.load_action(), times, force, tolerence=1e-5)
rig.record("folder", profil="forte")
vision.track("film.mraw", [], tolerence=1.0)
validation.compare("session", "hirschkorn2004", tolerence=1e-5)
"""


def public_names(package: str) -> list[str]:
    """Names that the stub of a package offers, modules left out."""
    stub = ROOT / package / "__init__.pyi"
    found: list[str] = []
    for node in ast.parse(stub.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.ImportFrom) and node.module is not None and node.level == 1:
            found += [alias.asname or alias.name for alias in node.names]
    return found


@pytest.fixture(scope="module")
def environment(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An environment that holds the built wheel and sees this one's other packages; its Python."""
    folder = tmp_path_factory.mktemp("installed")
    build = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)]
    subprocess.run(build, cwd=ROOT, check=True, capture_output=True)
    (wheel,) = folder.glob("*.whl")
    venv.create(folder / "env", with_pip=False)
    python = next(p for p in (folder / "env/bin/python", folder / "env/Scripts/python.exe") if p.exists())
    (site,) = [p for p in (folder / "env").rglob("site-packages") if p.is_dir()]
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(site)
        assert {f"{package}/py.typed" for package in PACKAGES} <= set(archive.namelist())
    (site / "others.pth").write_text(str(Path(np.__file__).parents[1]), encoding="utf-8")
    return python


def check(python: Path, source: str) -> list[str]:
    """Lines that the type checker prints about a file in an empty folder."""
    probe = python.parents[2] / "probe.py"
    probe.write_text(source, encoding="utf-8")
    (probe.parent / "stubs" / "pandas").mkdir(parents=True, exist_ok=True)
    (probe.parent / "stubs" / "pandas" / "__init__.pyi").write_text(UNTYPED, encoding="utf-8")
    config = probe.with_name("mypy.ini")
    config.write_text(NOT_READ, encoding="utf-8")
    options = ["--python-executable", str(python), "--config-file", str(config)]
    options += ["--cache-dir", str(probe.parent / "cache")]
    quiet = ["--ignore-missing-imports", "--follow-imports", "silent", "--no-error-summary"]
    done = subprocess.run(
        [sys.executable, "-m", "mypy", *options, *quiet, str(probe)],
        cwd=probe.parent,
        env=os.environ | {"MYPYPATH": str(probe.parent / "stubs")},
        capture_output=True,
        text=True,
    )
    assert done.stderr == ""
    return done.stdout.splitlines()


@pytest.mark.slow
def test_no_public_name_is_any(environment: Path) -> None:
    names = [f"{package}.{name}" for package in PACKAGES for name in public_names(package)]
    assert len(names) > 100
    source = "".join(f"import {package}\n" for package in PACKAGES)
    revealed = check(environment, source + "".join(f"reveal_type({name})\n" for name in names))
    types = [match[1] for line in revealed if (match := re.search(r'Revealed type is "(.*)"', line))]
    assert len(types) == len(names), [line for line in revealed if "error" in line]
    loose = {
        name: found
        for name, found in zip(names, types, strict=True)
        if found == "Any" or re.search(r"-> Any$|: Any[,)= ]", found)
    }
    assert loose == {}


@pytest.mark.slow
def test_a_misspelt_keyword_is_an_error(environment: Path) -> None:
    lines = [line for line in check(environment, MISSPELT) if "error: Unexpected keyword argument" in line]
    assert [int(line.split(":")[1]) for line in lines] == [5, 6, 7, 8], lines


@pytest.mark.parametrize("face", ["model", "vision", "rig", "validation"])
def test_every_public_name_exists_once(face: str) -> None:
    """No function or class has two names; an error of bad input is ``InputError`` of its package as well."""
    package = importlib.import_module(face)
    names: dict[int, list[str]] = {}
    for name in dir(package):
        found = getattr(package, name)
        if (inspect.isfunction(found) or inspect.isclass(found)) and name != "InputError":
            names.setdefault(id(found), []).append(name)
    assert [twice for twice in names.values() if len(twice) > 1] == []
