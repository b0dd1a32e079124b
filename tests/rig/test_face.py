"""What ``import rig`` gives: public names with their types, nothing heavy before it is needed."""

from __future__ import annotations

import inspect
import subprocess
import sys
import typing
from pathlib import Path

import pytest

import rig
from rig import RecordingOptions
from rig.recording.options import RecordingKeywords


def modules_after(program: str) -> set[str]:
    command = [sys.executable, "-c", f"{program}\nimport sys\nprint(*sys.modules)"]
    ended = subprocess.run(command, capture_output=True, text=True, check=True)
    return set(ended.stdout.split())


def test_every_listed_name_is_there() -> None:
    assert dir(rig) == sorted(rig.__all__)
    for name in rig.__all__:
        assert getattr(rig, name) is not None


def test_the_names_the_readme_promises() -> None:
    assert rig.recorder.record is rig.record
    assert not {"record_session", "recover_session", "resume_session"} & set(dir(rig))
    assert rig.InputError is rig.RigInputError is rig.errors.InputError


def test_public_functions_have_types_and_no_any() -> None:
    functions = [getattr(rig, name) for name in rig.__all__ if inspect.isfunction(getattr(rig, name))]
    assert len(functions) > 15
    for function in functions:
        for name in inspect.signature(function).parameters:
            assert name in function.__annotations__, f"{function.__name__}: {name}"
        assert typing.Any not in function.__annotations__.values() and "return" in function.__annotations__


def test_importing_the_face_loads_nothing_heavy() -> None:
    loaded = modules_after("import rig")
    assert not loaded & {"numpy", "h5py", "pydantic", "nidaqmx", "numba", "scipy", "pandas", "model", "vision"}


def test_reading_a_session_through_the_face_needs_no_driver_and_no_compiler() -> None:
    folder = Path(__file__).parents[2] / "sessions" / "example_forte"
    loaded = modules_after(f"import rig\nrig.Session.open({str(folder)!r}).trials[0].read()")
    assert not loaded & {"nidaqmx", "numba", "scipy", "pandas", "matplotlib", "model", "vision", "rig.simulated"}


def test_options_and_keywords_of_record_are_the_same() -> None:
    assert set(RecordingKeywords.__annotations__) == set(RecordingOptions.__dataclass_fields__)


def test_a_misspelt_keyword_is_refused_before_anything_is_made(tmp_path: Path) -> None:
    with pytest.raises(TypeError, match="trails"):
        rig.record(tmp_path / "s", trails=2)  # type: ignore[call-arg]
    with pytest.raises(TypeError, match="profile"):
        rig.resume(tmp_path / "s", rig.open_backend("sim://", rig.load_rig().config), profile="forte")  # type: ignore[call-arg]
    assert not (tmp_path / "s").exists()
