"""The rule that keeps numba's cache honest."""

from __future__ import annotations

import ast
from pathlib import Path

import vision


def test_no_compiled_function_is_called_from_another_file() -> None:
    """numba's disk cache notices only changes of the cached function's own file."""
    root = Path(vision.__file__).parent
    compiled: dict[Path, set[str]] = {}
    imported: dict[Path, set[str]] = {}
    for path in root.rglob("*.py"):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        compiled[path] = {
            node.name
            for node in ast.walk(tree)
            if isinstance(node, ast.FunctionDef) and any("njit" in ast.unparse(d) for d in node.decorator_list)
        }
        imported[path] = {
            alias.name for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) for alias in node.names
        }
    with_kernels = {path for path, found in compiled.items() if found}
    assert {path.name for path in with_kernels} == {
        *("assessment.py", "kernels.py", "occlusion.py", "prefilter.py"),
    }
    everything = set().union(*compiled.values())
    for path in with_kernels:
        assert not imported[path] & everything, f"{path} imports a compiled function"
