"""The rules that keep numba's cache honest."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

import vision
from vision.frame_fit.compiled import digest_of_sources, fit_bodies, walk

ROOT = Path(vision.__file__).parent
DECORATORS = ("cached_njit", "uncounted")


def compiled_and_imported() -> tuple[dict[Path, dict[str, bool]], dict[Path, set[str]]]:
    """Of each file its compiled functions, and whether they are cached; and the names it imports."""
    compiled: dict[Path, dict[str, bool]] = {}
    imported: dict[Path, set[str]] = {}
    for path in ROOT.rglob("*.py"):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        compiled[path] = {
            node.name: any(ast.unparse(d).startswith("cached_njit") for d in node.decorator_list)
            for node in ast.walk(tree)
            if isinstance(node, ast.FunctionDef)
            and any(ast.unparse(d).startswith(DECORATORS) for d in node.decorator_list)
        }
        imported[path] = {
            alias.name for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) for alias in node.names
        }
    return {path: found for path, found in compiled.items() if found}, imported


def test_no_compiled_function_is_called_from_another_file_unless_the_key_knows() -> None:
    """numba's disk cache notices only changes of the cached function's own file."""
    compiled, imported = compiled_and_imported()
    together = {path for path in compiled if path.parent.name == "frame_fit"}
    assert {path.name for path in compiled.keys() - together} == {
        *("assessment.py", "base.py", "frame_spline.py", "kernels.py", "light.py", "occlusion.py"),
    }
    assert {path.name for path in together} == {"compiled.py"}
    everything = set().union(*compiled.values())
    for path in compiled.keys() - together:
        assert not imported[path] & everything, f"{path} imports a compiled function"
    # what calls functions of other files is cached under their digest, or not at all
    cached = {name for path in together for name, is_cached in compiled[path].items() if is_cached}
    assert cached == {"fit_bodies", "walk"}


def test_the_key_of_frames_in_one_call_knows_all_sources(monkeypatch: pytest.MonkeyPatch) -> None:
    compiled, imported = compiled_and_imported()
    everything = set().union(*compiled.values())
    called = set().union(*(imported[path] & everything for path in compiled if path.parent.name == "frame_fit"))
    plain = digest_of_sources()
    for entry in (fit_bodies, walk):
        assert plain in [cell.cell_contents for cell in entry.py_func.__closure__]
    read = Path.read_bytes
    for path, functions in compiled.items():
        if not functions.keys() & called:
            continue
        changed = path
        monkeypatch.setattr(Path, "read_bytes", lambda p, c=changed: read(p) + (b"#" if p.samefile(c) else b""))
        assert digest_of_sources() != plain, f"a change of {path} would go unnoticed"
    monkeypatch.undo()
    assert digest_of_sources() == plain
