"""A user's type checker sees every public name of an installed wheel, and finds a misspelt keyword.

Run:  python .ci/check_types.py PYTHON        (the Python of an environment that holds the wheel)
"""

from __future__ import annotations

import ast
import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path

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
            found += [f"{package}.{alias.asname or alias.name}" for alias in node.names]
    return found


def check(folder: Path, python: str, source: str) -> list[str]:
    """Lines that the type checker prints about a file in a folder of its own."""
    (folder / "stubs" / "pandas").mkdir(parents=True, exist_ok=True)
    (folder / "stubs" / "pandas" / "__init__.pyi").write_text(UNTYPED, encoding="utf-8")
    (folder / "probe.py").write_text(source, encoding="utf-8")
    (folder / "mypy.ini").write_text(NOT_READ, encoding="utf-8")
    options = ["--python-executable", python, "--config-file", "mypy.ini", "--cache-dir", "cache"]
    options += ["--ignore-missing-imports", "--follow-imports", "silent", "--no-error-summary"]
    done = subprocess.run(
        [sys.executable, "-m", "mypy", *options, "probe.py"],
        cwd=folder,
        env=os.environ | {"MYPYPATH": "stubs", "PYTHONPATH": ""},
        capture_output=True,
        text=True,
    )
    if done.stderr:
        raise SystemExit(done.stderr)
    return done.stdout.splitlines()


def complaints(folder: Path, python: str) -> list[str]:
    """What a user's type checker does not see."""
    names = [name for package in PACKAGES for name in public_names(package)]
    source = "".join(f"import {package}\n" for package in PACKAGES)
    revealed = check(folder, python, source + "".join(f"reveal_type({name})\n" for name in names))
    types = [match[1] for line in revealed if (match := re.search(r'Revealed type is "(.*)"', line))]
    if len(types) != len(names):
        return [line for line in revealed if "error" in line] or [f"{len(types)} of {len(names)} names are revealed"]
    said = [
        f"{name}: {found}"
        for name, found in zip(names, types, strict=True)
        if found == "Any" or re.search(r"-> Any$|: Any[,)= ]", found)
    ]
    lines = [line for line in check(folder, python, MISSPELT) if "error: Unexpected keyword argument" in line]
    if [int(line.split(":")[1]) for line in lines] != [5, 6, 7, 8]:
        said.append(f"a misspelt keyword is not an error: {lines}")
    return said


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as work:
        found = complaints(Path(work), sys.argv[1])
    print("\n".join(found) or "a type checker sees every public name")
    raise SystemExit(bool(found))
