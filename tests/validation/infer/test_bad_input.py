"""What cannot be identified is refused in one clear line, before any work and with nothing half-written."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import model
from rig.session import Session
from rig.session.info import NO_FORCE, ActionInfo
from tests.validation.infer import toy
from validation.conventions import Array
from validation.errors import ValidationInputError
from validation.infer.fit import fit
from validation.infer.identify import check_identifiability, identify, list_bounds_not_run
from validation.infer.observations import observe, observe_driven
from validation.infer.problem import Columns, Problem
from validation.infer.response import Own
from validation.infer.sources import IdentifyOptions, collect
from validation.infer.unknowns import expand, unknowns
from validation.pipeline.compare import compare as compare_session
from validation.report.files import check_target

SESSIONS = Path(__file__).parents[3] / "sessions"
ACTION = model.load_action()


def refused(error: pytest.ExceptionInfo[ValidationInputError]) -> str:
    """The message, which is one line."""
    said = str(error.value)
    assert "\n" not in said
    return said


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("contact07.second.shape", "fixed by the geometry .it says 'hybrid'"),
        ("contact04.second.normal.x", "fixed by the geometry, as one component of a direction"),
        ("hammer.parent", "fixed by the geometry"),
        ("contact99.friction", "no such parameter"),
        ("contact02.friction", "no prior"),
        ("hammer.jiont_friction.A", "did you mean hammer.joint_friction.A"),
    ],
)
def test_a_parameter_that_cannot_be_free_is_refused_by_name(name: str, said: str) -> None:
    with pytest.raises(ValidationInputError, match=said) as error:
        unknowns(ACTION, [name])
    assert name in refused(error)


@pytest.mark.processor
def test_a_set_without_a_rest_state_is_refused_in_one_line() -> None:
    floating = ACTION.with_values({"gravity.g": 0.0})
    with pytest.raises(
        ValidationInputError, match="the model cannot run .*; use other values \\(`overrides`\\)"
    ) as error:
        identify([SESSIONS / "example_forte"], ["hammer.joint_friction"], floating, fixed=("*",), phases=5)
    said = refused(error)
    with pytest.raises(ValidationInputError) as error:  # a comparison says the same
        compare_session(Session.open(SESSIONS / "example_forte"), floating, budget=False, explain=False)
    assert refused(error) == said


def test_a_pattern_leaves_out_what_the_geometry_fixes_and_fix_does_not() -> None:
    assert "contact04.second.normal.x" not in expand(ACTION, ["contact04.*"])
    assert "contact04.second.x" in expand(ACTION, ["contact04.*"])
    assert "contact04.second.normal.x" in expand(ACTION, ["*"], "`fixed`")


def test_trials_with_neither_force_nor_key_motion_are_refused_with_the_reason(tmp_path: Path) -> None:
    session = Session.create(tmp_path / "blind", Session.open(SESSIONS / "example_forte").info)
    for trial in Session.open(SESSIONS / "example_forte").trials[:2]:
        data = trial.read()
        kept = [k for k, encoder in enumerate(data.encoders) if encoder.name != "key"]
        lost = np.full(data.time_s.size, np.nan)
        session.add_trial(
            replace(
                data, raw_force_n=lost, force_raw=lost, force_info=NO_FORCE,
                encoders=tuple(data.encoders[k] for k in kept), encoder_count=data.encoder_count[:, kept],
            )
        )  # fmt: skip
    with pytest.raises(
        ValidationInputError, match="no usable trial to fit .*neither force nor measured key motion"
    ) as error:
        identify([session.path], ["hammer.joint_friction"], fixed=("*",))
    said = refused(error)
    assert "a fit needs measured key, whippen and hammer angles" in said
    assert said.count("neither force") == 1 and "trials 1, 2" in said  # one reason is said once


@pytest.mark.parametrize("see", [observe, observe_driven])
def test_an_encoder_that_stands_still_is_refused_by_name(see: Callable[..., Any]) -> None:
    """A broken cable ended in an index that was out of bounds."""
    first, second, *_ = collect([SESSIONS / "example_forte"], ACTION, IdentifyOptions(phases=5)).measured
    for place, channel in enumerate(("key", "whippen", "hammer")):
        dead = replace(second, change_rad=second.change_rad * (np.arange(3) != place))
        with pytest.raises(ValidationInputError, match=f"one, trial 2: the {channel} encoder stands still") as error:
            see("one", 0, [first, dead], 5)
        refused(error)


@pytest.mark.parametrize("what", ["name", "key"])
def test_sessions_of_different_actions_are_refused(what: str, make: SimpleNamespace, tmp_path: Path) -> None:
    folders = [tmp_path / "a", tmp_path / "b", tmp_path / "c"]
    for folder, value in zip(folders, ("one", "unknown", "two"), strict=True):
        about = ActionInfo(**{"name": "grand", "key": "52"} | {what: value})
        Session.create(folder, make.info(name="try", action=about))
        shutil.copy(SESSIONS / "example_forte" / "trial_0001.h5", folder)
    with pytest.raises(ValidationInputError, match="sessions of different actions") as error:
        collect(folders, ACTION, IdentifyOptions())
    assert "'one' in a" in refused(error) and "'two' in c" in refused(error)


def made(n: int = 3) -> Problem:
    return toy.problem(toy.made(np.zeros(3), n, np.random.default_rng(1)))


def test_fewer_data_than_parameters_are_refused() -> None:
    p = made(1)
    short = replace(p.trials[0], time_s=toy.TIME[:0], change_rad=np.zeros((0, 3)))
    with pytest.raises(ValidationInputError, match="found 0 data for 3 parameters; record more trials") as error:
        check_identifiability(replace(p, trials=(short,)), Columns(p))
    refused(error)


class Stuck(toy.Toy):
    """A model that cannot run where the first parameter is large, or anywhere."""

    limit = 2.0

    def curves(self, points: Sequence[Array], own: Sequence[Sequence[Own]] | None = None) -> list[list[Array] | None]:
        found = super().curves(points, own)
        return [None if z[0] >= self.limit else one for z, one in zip(points, found, strict=True)]


def test_a_model_that_cannot_run_at_the_start_is_refused() -> None:
    p = made()
    nowhere = Stuck(p.trials)
    nowhere.limit = -np.inf
    with pytest.raises(ValidationInputError, match="cannot run these strokes; use other values") as error:
        check_identifiability(replace(p, response=nowhere), Columns(p))
    refused(error)
    with pytest.raises(ValidationInputError, match="cannot run at the start"):
        fit(replace(p, response=nowhere))


def test_an_end_of_the_range_at_which_the_model_cannot_run_is_named() -> None:
    p = made()
    assert list_bounds_not_run(p) == []
    (line,) = list_bounds_not_run(replace(p, response=Stuck(p.trials)))
    assert line.startswith("key.joint_friction.A: the model cannot run at the upper end of its range (0.04")


def test_where_the_file_would_go_is_checked_first(tmp_path: Path) -> None:
    (tmp_path / "folder.toml").mkdir()
    for name, said in (
        ("found.json", "allowed .toml"), ("none/found.toml", "there is no folder"), ("folder.toml", "is a folder")
    ):  # fmt: skip
        with pytest.raises(ValidationInputError, match=said) as error:
            check_target(tmp_path / name)
        refused(error)


def test_a_folder_that_takes_no_file_is_found_out_first(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(self: Path, *given: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "touch", full)
    with pytest.raises(ValidationInputError, match="cannot be written .No space left on device.; choose") as error:
        check_target(tmp_path / "found.toml")
    refused(error)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("held", "said"),
    [((2, 77), "`hold_out_trials` 77: no session to fit has .*; found 1, 2, 3"), ((1, 2, 3), "3 held out by `hold")],
)
def test_trials_to_hold_out_must_be_there_and_not_all_of_them(held: tuple[int, ...], said: str) -> None:
    with pytest.raises(ValidationInputError, match=said) as error:
        collect([SESSIONS / "example_forte"], ACTION, IdentifyOptions(hold_out_trials=held))
    refused(error)


def test_a_copy_of_a_session_is_the_same_strokes_to_fit_or_to_hold_out(tmp_path: Path) -> None:
    copy = shutil.copytree(SESSIONS / "example_forte", tmp_path / "copy")
    with pytest.raises(ValidationInputError, match="is the same stroke as example_forte .*, trial 1 .by") as error:
        collect([copy], ACTION, IdentifyOptions(hold_out=(SESSIONS / "example_forte",)))
    refused(error)


def test_sessions_of_one_name_keep_their_hashes_apart(tmp_path: Path) -> None:
    """Named by their folder where two have one name, by the whole path where their folders have one name too."""
    for place, numbers in (("one/try", (1,)), ("two/try", (2,)), ("two/again", (3,))):
        copy = shutil.copytree(SESSIONS / "example_forte", tmp_path / place)
        for path in copy.glob("trial_*"):
            if int(path.name[6:10]) not in numbers:
                path.unlink()

    def labels(*places: str) -> list[str]:
        return list(collect([tmp_path / place for place in places], ACTION, IdentifyOptions()).seals)

    (name,) = labels("one/try")
    assert labels("one/try", "two/again") == [
        name.replace(",", f" ({x}),").replace("trial 1", f"trial {n}") for x, n in (("try", 1), ("again", 3))
    ]
    first, second = labels("one/try", "two/try")
    assert str(tmp_path / "one" / "try") in first and str(tmp_path / "two" / "try") in second
