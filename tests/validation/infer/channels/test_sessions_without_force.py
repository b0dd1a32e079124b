"""Sessions without a force and with films: what is compared of each, and what is not used."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import model
from rig import RigInputError
from rig.session import Session, TrialData
from rig.session.force_correction import quiet_of_motion
from rig.session.info import NO_FORCE
from validation.infer.observations import ENCODERS, FILM
from validation.infer.sources import IdentifyOptions, collect


def without_force(data: TrialData) -> TrialData:
    """The trial as a bench without a load cell records it."""
    nothing = np.full(data.time_s.size, np.nan)
    return replace(data, raw_force_n=nothing, force_raw=nothing, force_info=NO_FORCE)


@pytest.fixture(scope="module")
def two(make: SimpleNamespace, tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Three filmed trials with a force, and as many a little stronger, kept without their force."""
    folder = tmp_path_factory.mktemp("two")
    forced, _ = make.session(folder / "forced", n_trials=3, filmed=(1, 3))
    others, _ = make.session(folder / "others", n_trials=3, filmed=(1, 3), strength=(1.02, 1.03, 0.98))
    driven = Session.create(folder / "driven", make.info(name="driven"))
    for trial in others.trials:
        driven.add_trial(without_force(trial.read()))
        derived = others.read_derived("angles", trial.number)
        if derived is not None:
            driven.write_derived("angles", trial.number, derived[0])
    return [forced.path, driven.path]


def test_what_is_compared_of_each(two: list[Path]) -> None:
    found = collect(two, model.load_action(), IdentifyOptions(film=True, phases=20))
    forced, driven = found.fitted[:3], found.fitted[3:]
    assert all(t.key is None and t.channels == (*ENCODERS, *FILM) for t in forced)
    assert all(t.key is not None and t.channels == (1, 2, *FILM) for t in driven)
    assert not np.isfinite(forced[1].column("jack")).any() and np.isfinite(forced[0].column("jack")).sum() > 10
    assert len(found.measured) == 3  # the bench of what a force drives: events are those of blows
    assert all(t.key_moves for t in found.fitted) and "3 trials have no force" in found.notes[0]


def test_what_is_not_used_is_said(two: list[Path]) -> None:
    plain = collect(two[:1], model.load_action(), IdentifyOptions(phases=20))
    assert any("2 trials have tracked films, which are not used" in line for line in plain.notes)
    assert all(t.channels == ENCODERS and not t.key_moves for t in plain.fitted)
    driven = collect(two[:1], model.load_action(), IdentifyOptions(phases=20, motion_driven=True))
    assert all(t.channels == (1, 2) for t in driven.fitted) and not driven.measured


@pytest.mark.parametrize(
    ("counts", "said"),
    [
        (lambda t: np.zeros(t.size), "no encoder moves by more than three counts"),
        (lambda t: 1000 * (t > 0.022), "encoders rest for .* 20 ms are needed before the blow"),
    ],
)
def test_a_trial_that_does_not_begin_at_rest_is_refused(counts: Callable[[np.ndarray], np.ndarray], said: str) -> None:
    time = np.arange(0.0, 0.3, 2e-4)
    with pytest.raises(RigInputError, match=said):
        quiet_of_motion(time, np.asarray(counts(time), dtype=np.int64)[:, None])
