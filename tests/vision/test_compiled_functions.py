"""The rule that keeps numba's cache honest: a key knows all sources that compiled functions are made of."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

import vision
from vision import kernel_cache
from vision.kernel_cache import SOURCES, digest_of_sources

ROOT = Path(vision.__file__).parent
DECORATORS = ("cached_njit", "inner_njit")


def imported_files(tree: ast.Module) -> set[Path]:
    """Files of the package from which functions or constants, not types, are imported."""
    found = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module is not None and node.module.startswith("vision."):
            path = ROOT.parent / Path(*node.module.split("."))
            if any(not alias.name[0].isupper() or alias.name.isupper() for alias in node.names):
                found.add(path.with_suffix(".py"))
    return found - {ROOT / "kernel_cache.py"}


def test_all_that_is_compiled_and_its_constants_are_part_of_the_key() -> None:
    known = {path for source in SOURCES for path in (*(ROOT / source).rglob("*.py"), ROOT / source)}
    holders = set()
    for path in ROOT.rglob("*.py"):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        decorators = [d for n in ast.walk(tree) if isinstance(n, ast.FunctionDef) for d in n.decorator_list]
        if any(ast.unparse(one).startswith(DECORATORS) for one in decorators):
            holders |= {path, *imported_files(tree)}
    assert ROOT / "frame_fit" / "compiled.py" in holders and holders <= known


def test_a_change_of_any_source_changes_the_key(monkeypatch: pytest.MonkeyPatch) -> None:
    digest, plain, read = digest_of_sources.__wrapped__, digest_of_sources(), Path.read_bytes
    assert digest() == plain
    for source in SOURCES:
        changed = sorted((ROOT / source).rglob("*.py"))[-1] if (ROOT / source).is_dir() else ROOT / source
        monkeypatch.setattr(Path, "read_bytes", lambda p, c=changed: read(p) + (b"#" if p.samefile(c) else b""))
        assert digest() != plain, f"a change of {changed} would go unnoticed"


def test_what_was_compiled_from_other_sources_is_not_loaded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("numba.core.config.CACHE_DIR", str(tmp_path))

    def doubled(x: float) -> float:
        return 2.0 * x

    def found_on_disk() -> int:
        kept = kernel_cache.cached_njit()(doubled)
        assert kept(1.5) == 3.0
        return sum(kept.stats.cache_hits.values())

    assert [found_on_disk(), found_on_disk()] == [0, 1]
    monkeypatch.setattr(kernel_cache, "digest_of_sources", lambda: "of other sources")
    assert [found_on_disk(), found_on_disk()] == [0, 1]
