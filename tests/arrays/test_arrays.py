"""Arrays as users have them: every public function and method that takes arrays, drawn from the public names.

Each gives the same bits for every form of the same numbers, and refuses in one line of the project's own what is no
array of real numbers. A new public function is here by being public: its smallest call is added to the calls.
"""

from __future__ import annotations

import dataclasses
import inspect
import pkgutil
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any
from unittest.mock import MagicMock

import numpy as np
import pytest

import model
import vision
from pianorig.errors import CommandInputError
from rig import RigInputError
from tests.arrays import model_calls, other_calls
from tests.arrays.forms import DIMENSIONS, FORMS, REFUSED, Out, answer, changed, plain
from tests.public_functions import ROOT, array_parameters, public_classes, with_methods
from validation import ValidationInputError
from vision.synthetic import Scene, Sensor, SyntheticBody, background, box, speckle

CALLS = model_calls.CALLS | other_calls.CALLS
HEAVY = model_calls.HEAVY | other_calls.HEAVY
ANY_SHAPE = {*model_calls.ANY_SHAPE, *other_calls.ANY_SHAPE}
OWN = (model.InputError, vision.InputError, RigInputError, ValidationInputError, CommandInputError)
TAKERS = {name: taken for name, function in with_methods().items() if (taken := array_parameters(function))}
FUNCTIONS = with_methods()
CLASSES = public_classes()


class Stopped(Exception):
    """The costly step was reached; holds what reached it, or what it gave."""


def stop_at(steps: tuple[str, ...], patch: pytest.MonkeyPatch) -> None:
    """Leave all steps out, and stop at the last one."""
    left = {step: steps.count(step) for step in steps}
    for step in left:
        where, name = step.removeprefix("gives ").rsplit(".", 1)
        owner = pkgutil.resolve_name(where)
        real = getattr(owner, name)

        def stand_in(*given: Any, step: str = step, real: Any = real, **named: Any) -> Any:
            left[step] -= 1
            if step != steps[-1] or left[step]:
                return MagicMock()
            if step.startswith("gives "):
                raise Stopped(real(*given, **named))
            raise Stopped([one.content() if isinstance(one, model.Action) else one for one in (*given, named)])

        patch.setattr(owner, name, stand_in)


def called(name: str, arguments: dict[str, Any], folder: Path) -> Any:
    """The answer of a call, with the file it wrote."""
    function: Callable[..., Any] = CLASSES[name] if name in CLASSES else FUNCTIONS[name]
    out = [folder / value.name for value in arguments.values() if isinstance(value, Out)]
    given = {k: folder / v.name if isinstance(v, Out) else v for k, v in arguments.items()}
    try:
        found = function(**given)
    except Stopped as stopped:
        return answer(list(stopped.args))
    for member in found if isinstance(found, list) else []:
        if error := getattr(member, "failure", None) or getattr(member, "error", None):
            raise error
    if isinstance(found, vision.ArrayFilm):
        found = found.read(found.n_frames - 1)
    written = [answer(path) for path in out]
    for path in out:
        path.unlink()
    return answer(found), written


def one_changed(name: str, parameter: str, form: Callable[[np.ndarray], Any]) -> dict[str, Any]:
    """The arguments of a call, the arrays of one of them in a form, all others as they are."""
    return {k: changed(v, form if k == parameter else plain) for k, v in CALLS[name]().items()}


def test_every_public_function_that_takes_arrays_is_called_here() -> None:
    missing = {name: taken for name, taken in TAKERS.items() if name not in CALLS}
    assert not missing, f"take arrays, and have no call in tests/arrays/*_calls.py: {missing}"
    assert not CALLS.keys() - TAKERS.keys(), f"not public, or take no arrays: {sorted(CALLS.keys() - TAKERS.keys())}"
    for name, taken in TAKERS.items():
        assert set(taken) <= CALLS[name]().keys(), f"the call of {name} leaves out some of {taken}"


@pytest.mark.parametrize("name", CALLS)
def test_the_same_numbers_give_the_same_bits_in_every_form(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    wanted: Any = None
    for kind, form in {"as it is": plain, **FORMS}.items():
        with monkeypatch.context() as patch:
            if name in HEAVY:
                stop_at(HEAVY[name], patch)
            found = called(name, {k: changed(v, form) for k, v in CALLS[name]().items()}, tmp_path)
        wanted = wanted or found
        assert found == wanted, kind


@pytest.mark.parametrize("name", CALLS)
def test_what_is_no_array_of_real_numbers_is_refused_in_one_line(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    wrong = REFUSED if name in ANY_SHAPE else REFUSED | DIMENSIONS
    for parameter in TAKERS[name]:
        for kind, form in wrong.items():
            with monkeypatch.context() as patch, pytest.raises(OWN) as refused:
                if name in HEAVY:
                    stop_at(HEAVY[name], patch)
                called(name, one_changed(name, parameter, form), tmp_path)
                pytest.fail(f"{parameter}: {kind} is taken")
            assert len(str(refused.value).splitlines()) == 1


@pytest.mark.parametrize("name", CALLS)
def test_lost_numbers_are_taken_or_refused_in_one_line(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def lost(a: np.ndarray) -> np.ndarray:
        out = a.astype(float)
        out[(0,) * out.ndim if out.size else ...] = np.nan
        return out

    for parameter in TAKERS[name]:
        with monkeypatch.context() as patch:
            if name in HEAVY:
                stop_at(HEAVY[name], patch)
            try:
                called(name, one_changed(name, parameter, lost), tmp_path)
            except (*OWN, model.ModelError) as refused:
                assert len(str(refused).splitlines()) == 1


def records() -> dict[str, type]:
    """Public records with arrays that a public function takes."""
    taken = " ".join(str(p.annotation) for f in FUNCTIONS.values() for p in inspect.signature(f).parameters.values())
    with_arrays = (c for c in CLASSES.items() if dataclasses.is_dataclass(c[1]) and array_fields(c[1]))
    return {name: one for name, one in with_arrays if re.search(rf"\b{one.__name__}\b", taken)}


def array_fields(record: Any) -> dict[str, str]:
    fields = {field.name: str(field.type) for field in dataclasses.fields(record)}
    return {name: kind for name, kind in fields.items() if re.fullmatch(r"(Array|NDArray\[.*\])( \| None)?", kind)}


MADE: dict[str, dict[str, Any]] = {
    "model.KeyMotion": {"break_s": np.array([0.0, 1.0]), "coefficient": np.ones((1, 6))},
    "model.drive.DriveLog": {
        name: np.arange(200.0) for name in ("time_s", "command_v", "force_n", "arm_rad", "current_a")
    },
    "vision.Body": {"name": "plate", "polygon_px": np.array([[2.0, 2.0], [13.0, 2.0], [13.0, 9.0]])},
    "vision.CalibratedCamera": {
        "width": 16, "height": 12, "parameters": np.zeros(5), "covariance": np.eye(5), "scale_px_per_m": 1.0,
        "u_scale_px_per_m": 0.0,
    },
}  # fmt: skip


@pytest.mark.parametrize("name", records())
def test_a_record_that_functions_take_holds_plain_arrays(name: str) -> None:
    fields = array_fields(CLASSES[name])
    made = MADE.get(name) or {
        field.name: np.arange(6.0).reshape(2, 3) if field.name in fields else None
        for field in dataclasses.fields(CLASSES[name])
        if field.init
    }
    wanted = CLASSES[name](**changed(made, plain))
    for kind, form in FORMS.items():
        found = CLASSES[name](**changed(made, form))
        for field in fields:
            array = getattr(found, field)
            assert type(array) is np.ndarray and array.dtype.isnative and array.flags.c_contiguous, (kind, field)
            assert array.dtype == getattr(wanted, field).dtype, (kind, field)
            np.testing.assert_array_equal(array, getattr(wanted, field), err_msg=f"{kind} {field}")
    for field in fields:
        for form in REFUSED.values():
            with pytest.raises(OWN) as refused:
                CLASSES[name](**{k: changed(v, form if k == field else plain) for k, v in made.items()})
            assert len(str(refused.value).splitlines()) == 1


def test_an_array_that_fits_is_not_copied() -> None:
    times, force = np.array([0.0, 1.0]), np.array([0.0, 4.0])
    assert all(a is b for a, b in zip(model.check_force_table(times, force), (times, force), strict=True))
    assert model.State(0.0, force, force).angle_rad is force
    frames = np.zeros((2, 12, 16), np.uint16)
    assert np.shares_memory(vision.ArrayFilm(frames).read(1), frames)
    other = vision.ArrayFilm(frames.astype(">u2"))
    assert (other.bit_depth, other.read(1).dtype) == (16, np.dtype(np.uint16))


def test_what_a_mask_hides_is_lost_and_not_read() -> None:
    hidden = np.ma.masked_array([0.0, 4.0], mask=[False, True])
    with pytest.raises(model.InputError, match="row 2: force_n found nan"):
        model.check_force_table([0.0, 1.0], hidden)


def test_a_film_of_any_layout_gives_the_same_poses() -> None:
    extent = (-20.0, -16.0, 20.0, 16.0)
    body = SyntheticBody("plate", box(-16.0, -12.0, 16.0, 12.0), speckle(extent, 5))
    scene, sensor = Scene([body], background(64, 80, 6)), Sensor(2.0, 8, 1)
    turns = np.concatenate([np.zeros(6), 0.01 * np.arange(1.0, 4.0)])
    frames = np.stack([sensor.expose(scene.light(np.array([[[turn, 40.0, 32.0]]])), 1.0) for turn in turns])
    outline = [vision.Body("plate", np.array([[26, 22], [54, 22], [54, 42], [26, 42]]))]
    kinds = {"as it is": plain, **{k: FORMS[k] for k in ("read-only", "strided", "backwards", "columns first", "hard")}}
    found = {
        kind: answer(vision.track(vision.ArrayFilm(form(frames), 1000.0), outline, n_still=6, threads=1).angle_rad)
        for kind, form in kinds.items()
    }
    assert len(set(found.values())) == 1, found.keys()


@pytest.mark.parametrize("name", ["arrays.py", "keywords.py", "tabular.py"])
def test_three_packages_that_import_nothing_of_each_other_have_one_text(name: str) -> None:
    texts = []
    for package, error in (("model", "InputError"), ("vision", "VisionInputError"), ("rig", "RigInputError")):
        text = (ROOT / package / name).read_text(encoding="utf-8")
        text = re.sub(rf"`*\b{error}\b`*", "ERROR", text.replace(f"from {package}.", "from "))
        text = re.sub(r"def as_points.*?(?=\n\nclass )", "", text, flags=re.DOTALL)
        writer = r"\b(?:whole_file|replace_when_complete)\b(?:\(target[^)]*\))?"  # each package's own
        text = re.sub(r"from \S+ import (?:ERROR|WRITER)\n", "", re.sub(writer, "WRITER", text))
        texts.append(re.sub(r"\s+", "", text))
    assert texts[0] == texts[1] == texts[2]
