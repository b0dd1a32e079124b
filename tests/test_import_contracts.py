"""The import rules of the house (pyproject.toml, [tool.importlinter]) are kept, and would be noticed if broken."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]


def lint(folder: Path) -> subprocess.CompletedProcess[str]:
    code = (
        "import sys; sys.path.insert(0, '.'); from importlinter.cli import lint_imports_command; lint_imports_command()"
    )
    return subprocess.run([sys.executable, "-c", code, "--no-cache"], cwd=folder, capture_output=True, text=True)


def test_contracts_are_kept() -> None:
    done = lint(ROOT)
    assert done.returncode == 0, done.stdout


def test_a_wrong_import_is_noticed(tmp_path: Path) -> None:
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    for package in ("model", "vision", "rig", "validation", "pianorig"):
        shutil.copytree(ROOT / package, tmp_path / package, ignore=shutil.ignore_patterns("__pycache__"))
    (tmp_path / "vision" / "wrong.py").write_text("import model.parameters.action\n")
    (tmp_path / "rig" / "wrong.py").write_text("import model.parameters.action\n")
    done = lint(tmp_path)
    assert done.returncode != 0
    assert "vision.wrong" in done.stdout and "rig.wrong" in done.stdout, done.stdout
