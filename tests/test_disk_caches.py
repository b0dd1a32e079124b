"""No entry of a kernel cache is loaded that is not exactly what was written; what else is there is compiled again."""

from __future__ import annotations

import importlib.util
import inspect
import os
import shutil
import warnings
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import numba
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import model
from model.codegen import load
from model.kernels import compile as compiling
from model.kernels import disk_cache
from model.kernels.compile import numba_config
from vision import kernel_cache

Damage = Callable[[Path], None]


def test_both_packages_keep_entries_by_the_same_lines() -> None:
    def shared(cache: ModuleType) -> str:
        source = inspect.getsource(cache)
        begin = source.index("def read_entry")
        return source[begin : source.index("class _VerifiedCache")]

    assert shared(disk_cache) == shared(kernel_cache) and shared(disk_cache).count("\n") > 70


def cut(path: Path, size: int) -> None:
    path.write_bytes(path.read_bytes()[:size])


def flip(path: Path, share: float, bit: int) -> None:
    data = bytearray(path.read_bytes())
    data[int(share * (len(data) - 1))] ^= 1 << bit
    path.write_bytes(data)


def replace_start(path: Path, start: bytes) -> None:
    path.write_bytes(start + path.read_bytes()[len(start) :])


def put_folder(path: Path) -> None:
    path.unlink()
    path.mkdir()


DAMAGES: dict[str, Damage] = {
    "bit in the middle": lambda path: flip(path, 0.5, 0),
    "empty": lambda path: cut(path, 0),
    "half": lambda path: cut(path, path.stat().st_size // 2),
    "garbage": lambda path: replace_start(path, b"\x80garbage" * 8),
    "folder": put_folder,
}


@pytest.fixture(autouse=True)
def fresh_warnings(monkeypatch: pytest.MonkeyPatch) -> None:
    for cache in (disk_cache, kernel_cache):
        monkeypatch.setattr(cache, "_warned", set())


@settings(max_examples=60, deadline=None)
@given(content=st.binary(max_size=300), at=st.floats(0.0, 1.0), bit=st.integers(0, 7), kept=st.floats(0.0, 1.0))
def test_an_entry_is_read_as_it_was_written_or_not_at_all(
    tmp_path_factory: pytest.TempPathFactory, content: bytes, at: float, bit: int, kept: float
) -> None:
    path = tmp_path_factory.mktemp("entry") / "scene_0.o"
    assert disk_cache.read_entry(path) is None
    disk_cache.write_entry(path, content)
    assert disk_cache.read_entry(path) == content
    assert [file.name for file in path.parent.iterdir()] == ["scene_0.o"]
    other = path.with_name("scene_1.o")
    shutil.copyfile(path, other)
    whole = path.read_bytes()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        assert disk_cache.read_entry(other) is None  # an entry of another name
        flip(path, at, bit)
        assert disk_cache.read_entry(path) is None
        path.write_bytes(whole[: int(kept * (len(whole) - 1))])
        assert disk_cache.read_entry(path) is None


def test_one_warning_names_the_first_entry_that_is_damaged(tmp_path: Path) -> None:
    for name in ("a.o", "b.o"):
        (tmp_path / name).write_bytes(b"machine code")
    with pytest.warns(UserWarning) as seen:
        assert disk_cache.read_entry(tmp_path / "a.o") is None and disk_cache.read_entry(tmp_path / "b.o") is None
    (line,) = [str(one.message) for one in seen]
    assert "a.o: is damaged" in line and "compiled again" in line and "\n" not in line


def test_a_folder_that_cannot_be_written_costs_a_warning(tmp_path: Path) -> None:
    (tmp_path / "a_file").touch()
    with pytest.warns(UserWarning, match=r"cannot be written \(Not a directory\)"):
        disk_cache.write_entry(tmp_path / "a_file" / "scene_0.o", b"code")


def test_a_write_that_ends_in_its_middle_leaves_the_entry_that_was_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "scene_0.o"
    disk_cache.write_entry(path, b"first")

    def full(*_: Any) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.warns(UserWarning, match="No space left"):
        disk_cache.write_entry(path, b"second")
    assert disk_cache.read_entry(path) == b"first" and list(tmp_path.iterdir()) == [path]


def keep_in_model(function: Any) -> Any:
    return disk_cache.verify_cache(numba.njit(function))


KEEPERS: dict[str, Callable[[Any], Any]] = {"model": keep_in_model, "vision": kernel_cache.cached_njit()}


@pytest.fixture
def compile_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[str], tuple[float, int]]]:
    """Run a small compiled function as a new process would: what it returns, and how often it was found on disk."""
    source = tmp_path / "small.py"
    source.write_text("def shifted(x):\n    return 2.0 * x + 0.3\n")
    monkeypatch.setattr(numba_config, "CACHE_DIR", str(tmp_path / "cache"))

    def run(keeper: str) -> tuple[float, int]:
        spec = importlib.util.spec_from_file_location("small", source)
        assert spec is not None and spec.loader is not None
        module: ModuleType = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        kept = KEEPERS[keeper](module.shifted)
        return kept(1.5), sum(kept.stats.cache_hits.values())

    yield run


def entries(folder: Path) -> list[Path]:
    return sorted(path for path in folder.rglob("*.nb?"))


@pytest.mark.parametrize("keeper", KEEPERS)
def test_damaged_entries_of_numba_are_compiled_again_to_the_same_number(
    keeper: str, compile_again: Callable[[str], tuple[float, int]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert compile_again(keeper) == (3.3, 0) and compile_again(keeper) == (3.3, 1)
    names = [path.name for path in entries(tmp_path / "cache")]
    assert [Path(name).suffix for name in names] == [".nbc", ".nbi"]
    for what, damage in DAMAGES.items():
        for path in entries(tmp_path / "cache"):
            monkeypatch.setattr(disk_cache, "_warned", set())
            monkeypatch.setattr(kernel_cache, "_warned", set())
            damage(path)
            with pytest.warns(UserWarning) as seen:
                assert compile_again(keeper) == (3.3, 0), f"{what}: {path.name}"
            lines = [str(one.message) for one in seen]
            if what == "folder":  # which no file can replace
                assert len(lines) == 2 and "cannot be read" in lines[0] and "cannot be written" in lines[1]
                path.rmdir()
                assert compile_again(keeper) == (3.3, 0)
            else:
                assert len(lines) == 1 and path.name in lines[0]
            assert compile_again(keeper) == (3.3, 1)
    assert [path.name for path in entries(tmp_path / "cache")] == names


@pytest.mark.parametrize("keeper", KEEPERS)
def test_an_index_that_names_the_code_of_another_key_is_not_believed(
    keeper: str, compile_again: Callable[[str], tuple[float, int]], tmp_path: Path
) -> None:
    """A process that ends between numba's writing of index and code leaves an index that names older code."""
    assert compile_again(keeper) == (3.3, 0)
    (code,) = (path for path in entries(tmp_path / "cache") if path.suffix == ".nbc")
    older = code.read_bytes()
    source = tmp_path / "small.py"
    # another length, too: bytecode counts as new by whole seconds and length
    source.write_text(source.read_text().replace("0.3", "0.70"))
    assert compile_again(keeper) == (3.7, 0)
    code.write_bytes(older)
    assert compile_again(keeper) == (3.7, 0) and compile_again(keeper) == (3.7, 1)


@pytest.mark.parametrize("keeper", KEEPERS)
def test_where_nothing_can_be_kept_functions_are_compiled_in_memory(
    keeper: str, compile_again: Callable[[str], tuple[float, int]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("numba.core.caching._CacheLocator.ensure_cache_path", lambda self: (tmp_path / "0").rmdir())
    assert compile_again(keeper) == (3.3, 0) and compile_again(keeper) == (3.3, 0)
    assert not (tmp_path / "cache").exists()


def test_a_damaged_scene_is_compiled_again_to_the_same_numbers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(compiling, "FOLDER", tmp_path)
    action = model.load_action()
    full = model.rest_state(action)
    rest = replace(full, angle_rad=full.angle_rad[:1])

    def run() -> tuple[list[float], int]:
        monkeypatch.setattr(load, "_loaded", {})  # as in the next process
        monkeypatch.setattr(disk_cache, "_warned", set())
        before = load.COMPILED["compiled"]
        out = model.simulate(action, [0.0, 0.01], [0.0, 1.0], scene="key", initial=rest, output_time_s=[0.005, 0.01])
        return out.angle_rad.ravel().tolist(), load.COMPILED["compiled"] - before

    numbers, compiled = run()
    assert compiled == 1 and run() == (numbers, 0)
    for what in ("bit in the middle", "empty", "half", "garbage"):
        for path in tmp_path.glob("scene_*.o"):
            DAMAGES[what](path)
        with pytest.warns(UserWarning, match=r"scene_\w+\.o: is damaged") as seen:
            assert run() == (numbers, 1), what
        assert len(seen) == 1 and run() == (numbers, 0)
