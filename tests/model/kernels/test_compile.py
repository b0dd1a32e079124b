"""The disk cache of compiled kernels never returns numbers of an edited kernel, and is used when nothing changed."""

from __future__ import annotations

from pathlib import Path

import pytest

import model
from model.kernels.compile import cache_key, cache_root, kernel_sources, numba_config
from model.kernels.lanes import has_wide_vectors


def test_every_compiled_module_of_the_step_loop_is_among_the_hashed_sources() -> None:
    package = Path(model.__file__).parent
    hashed = {path.relative_to(package).as_posix() for path in kernel_sources()}
    assert {"kernels/inputs.py", "elements/laws/stulov.py"} <= hashed
    files = {"elements/contacts.py", "codegen/step_programs.py", "compiler/native.py", "integrators/rosenbrock.py"}
    assert files <= hashed
    compiled = ("@kernel", "@inlined", "@uncounted", "@piece", "@step_loop", "@generated")
    for path in [*package.glob("kernels/**/*.py"), *package.glob("integrators/**/*.py")]:
        if any(word in path.read_text(encoding="utf-8") for word in compiled):
            assert path.relative_to(package).as_posix() in hashed


def test_an_edited_source_changes_the_key(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("model.kernels.compile._PACKAGE", tmp_path)
    keys = [cache_key()]
    for name in ("kernels/inputs.py", "elements/felts.py", "kernels/inputs.py"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        with (tmp_path / name).open("a") as file:
            file.write("# edited\n")
        keys.append(cache_key())
    assert len(set(keys)) == len(keys) and cache_key() == keys[-1]


@pytest.mark.parametrize(
    ("platform", "named", "where"),
    [("win32", "LOCALAPPDATA", "local"), ("linux", "XDG_CACHE_HOME", "cache"), ("win32", "PIANORIG_CACHE_DIR", "own")],
)
def test_kernels_lie_where_each_system_keeps_such_files(
    platform: str, named: str, where: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for place, variable in (("local", "LOCALAPPDATA"), ("cache", "XDG_CACHE_HOME")):
        monkeypatch.setenv(variable, str(tmp_path / place))
    monkeypatch.delenv("PIANORIG_CACHE_DIR", raising=False)
    monkeypatch.setenv(named, str(tmp_path / where))
    monkeypatch.setattr("model.kernels.compile.sys.platform", platform)
    expected = tmp_path / where
    assert cache_root() == (expected if where == "own" else expected / "piano-action-rig" / "kernels")


AVX2 = "+avx2,+fma,+sse4.2"


@pytest.mark.parametrize(
    ("name", "features", "pays"),
    [
        ("nehalem", "+sse4.2,+popcnt", False),
        ("generic", "", False),
        ("haswell", AVX2, True),
        ("haswell", "+avx2", False),  # no multiply-add
        ("skylake-avx512", "+avx512f", True),
        ("znver4", f"{AVX2},-avx512f", True),
        ("ivybridge", "+avx,-avx2,-fma", False),
    ],
)
def test_lanes_and_cache_follow_the_processor_that_is_compiled_for(
    name: str, features: str, pays: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    keys = set()
    for cpu_name, more in ((name, ""), (name, ",+aes"), ("x86-64", "")):
        monkeypatch.setattr(numba_config, "CPU_NAME", cpu_name)
        monkeypatch.setattr(numba_config, "CPU_FEATURES", features + more)
        keys.add(cache_key())
        assert has_wide_vectors.__wrapped__() is pays
    assert len(keys) == 3
