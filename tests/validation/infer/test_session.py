"""Identification of a played session from end to end, its action file, and what is refused."""

from __future__ import annotations

import html
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure

import model
import validation
from rig.session import Session
from validation.errors import ValidationInputError
from validation.infer.estimates import TOO_FEW
from validation.infer.identify import PROVISIONAL, identify
from validation.infer.response import ModelResponse
from validation.infer.result import FITTED
from validation.infer.sentences import plain_sentences
from validation.infer.sources import IdentifyOptions, collect
from validation.infer.unknowns import unknowns
from validation.infer.write import write_identified, write_reading
from validation.prediction.posterior import list_alterations, posterior_of
from validation.report.figures.overlays import trial_words
from validation.report.view import SessionView, as_sentence
from validation.statistics.skill import CALLED, RIVALS

QUICK = {"budget": False, "explain": False, "keep_predictions": False}
EXAMPLE = Path(__file__).parents[3] / "sessions" / "example_forte"
# the specimen of the example, but for what is asked for
SPECIMEN = {
    "key.joint_friction.A": 0.0155, "contact01.friction.A": 0.155, "contact04.friction.A": 0.36,
    "contact07.friction.A": 0.165, "contact10.friction.A": 0.28, "contact01.normal.D": 2.05,
    "contact02.normal.D": 1.6, "contact03.normal.D": 3.2, "contact12.normal.D": 0.19,
}  # fmt: skip


@pytest.fixture(scope="module")
def found() -> object:
    """The hammer's friction, all else as the specimen has it; one session and one name need no list."""
    start = model.load_action("hirschkorn2004", SPECIMEN)
    return identify(EXAMPLE, "hammer.joint_friction", start, fixed=("*",), hold_out_trials=(3,), phases=30)


def test_two_trials_give_an_interval_that_holds_the_truth_and_no_claim(found) -> None:  # type: ignore[no-untyped-def]
    (estimate,) = found.estimates
    assert estimate.low < 0.00111 < estimate.high
    assert estimate.verdict == TOO_FEW
    held = next(scores for name, scores in found.scores.items() if name.endswith("held out"))
    assert held["identified"]["hammer"] < held["before"]["hammer"] < held["null model"]["hammer"]


def test_what_was_found_is_a_table_a_picture_and_a_file(found, tmp_path: Path) -> None:  # type: ignore[no-untyped-def]
    (estimate,) = found.estimates
    row = found.to_frame().iloc[0]
    assert (row["name"], row["value"], row["verdict"]) == (estimate.name, estimate.value, estimate.verdict)
    axes = Figure().subplots()
    assert found.plot(ax=axes) is axes and [t.get_text() for t in axes.get_yticklabels()] == [estimate.name]
    assert axes.containers[0].lines[0].get_xdata()[0] == pytest.approx(estimate.value / estimate.prior - 1.0)
    assert pd.read_csv(found.save(tmp_path / "found.csv"))["high"][0] == estimate.high
    assert model.load_action(found.save(tmp_path / "found.toml"))["hammer.joint_friction.A"] == estimate.value
    assert repr(found).count("\n") < 12 and f"{estimate.value:.4g}" in repr(found)


def test_the_file_is_an_action_with_uncertainty_and_provenance(found, tmp_path: Path) -> None:  # type: ignore[no-untyped-def]
    target = tmp_path / "identified.toml"
    write_identified(found, target)
    action = model.load_action(target)
    quantity = action.quantities["hammer.joint_friction.A"]
    assert quantity.value == found.estimates[0].value and quantity.u == found.estimates[0].u
    table = tomllib.loads(target.read_text("utf-8"))["identification"]
    assert table["names"] == ["hammer.joint_friction.A"] and table["correlation"][0][0] == pytest.approx(1.0)
    assert len(table["provenance"]["trials_sha256"]) == 2
    assert table["parameters"]["hammer.joint_friction.A"]["verdict"] == found.estimates[0].verdict
    with pytest.raises(ValidationInputError, match="allowed .toml"):
        write_identified(found, tmp_path / "identified.json")


@pytest.fixture(scope="module")
def written(found, tmp_path_factory) -> dict[str, Path]:  # type: ignore[no-untyped-def]
    """Its action file and page, without the seconds that which part explains takes (`test_explained`)."""
    found.details.__dict__["explained"] = ("which part of the model explains it",)
    return write_reading(found, tmp_path_factory.mktemp("written") / "identified.toml")


def test_the_file_holds_the_joint_uncertainty_and_the_prediction(found, written) -> None:  # type: ignore[no-untyped-def]
    action = model.load_action(written["action"])
    assert not list_alterations(action)  # its hashes are those of what was written
    joint = posterior_of(action)
    assert joint is not None and joint.names[0] == "hammer.joint_friction.A"
    assert joint.moved == {"hammer.joint_friction.A"}  # errors of the force have no parameter of the action
    assert joint.covariance[0, 0] == pytest.approx(found.estimates[0].z_u ** 2, rel=1e-4)
    assert list(joint.trials.values()) == list(found.provenance["trials_sha256"].values())
    events = action.identification["events"]["example_forte, held out"]
    speed = {who: events[who]["hammer_speed"]["rms"] for who in ("identified", "before", "null model")}
    assert max(speed["identified"], speed["before"]) < 0.2 * speed["null model"]
    with pytest.raises(ValidationInputError, match="were fitted to example_forte, trial 1 already and to 1 more"):
        identify([EXAMPLE], ["hammer.joint_friction"], action, fixed=("*",))


def test_a_comparison_knows_how_far_the_strokes_lie_and_who_is_nearer(written) -> None:  # type: ignore[no-untyped-def]
    action = model.load_action(written["action"])
    joint = posterior_of(action)
    assert joint is not None and joint.before == {
        "hammer.joint_friction.A": model.load_action()["hammer.joint_friction.A"]
    }
    result = validation.compare(EXAMPLE, action, **QUICK)
    trials = result.trials.set_index("trial")
    assert trials["fitted"].to_dict() == {1: True, 2: True, 3: False} and trials["outside"].eq(False).all()
    assert any(line.startswith("Domain: trial 3: inside of what was fitted") for line in result.verdict_lines)
    rows = result.rivals.set_index(["trial", "channel"])
    names = [f"{name}_rmse_rad" for name in RIVALS]
    assert np.all(rows.loc[(3, "hammer"), names].astype(float) > rows.loc[(3, "hammer"), "rmse_rad"])
    hammer = result.channels.set_index("channel").loc["hammer"]
    best = rows.loc[(3, "hammer"), f"{hammer['best_rival']}_rmse_rad"]
    assert hammer["skill"] == pytest.approx(1 - rows.loc[(3, "hammer"), "rmse_rad"] / best) and np.isnan(
        hammer["skill_low"]
    )
    assert any("no interval" in line and line.startswith("Skill") for line in result.verdict_lines)


def session_of_others(tmp_path: Path) -> Session:
    """Trials 1 (fitted) and 3 (not) of the example under another name, start time, number, cut and first count."""
    shipped = Session.open(EXAMPLE)
    copy = Session.create(tmp_path / "another", shipped.info.model_copy(update={"name": "another"}))
    for number, of in ((5, 1), (6, 3)):
        data = shipped.trial(of).read()
        keep = slice(150, data.time_s.size - 40)
        cut = {name: getattr(data, name)[keep] for name in ("time_s", "raw_force_n", "force_raw", "motor_command_v")}
        cut["time_s"] = cut["time_s"] - cut["time_s"][0]
        count = data.encoder_count[keep] - data.encoder_count[keep][0] + 700
        copy.add_trial(
            replace(
                data,
                number=number,
                started_utc="2031-01-01T00:00:00Z",
                blow_start_s=0.0,
                encoder_count=count,
                camera=None,
                **cut,
            )
        )
    return copy


def test_samples_of_a_fitted_recording_count_as_fitted_in_any_session(written, tmp_path: Path) -> None:  # type: ignore[no-untyped-def]
    action = model.load_action(written["action"])
    result = validation.compare(session_of_others(tmp_path), action, **QUICK)
    assert result.trials.set_index("trial")["fitted"].to_dict() == {5: True, 6: False}
    assert result.provenance["action"]["fitted_to"] == ["trial_0005"]
    said = "\n".join(result.verdict_lines)
    assert "fitted to trial 5 (by hash); trial 6 was kept aside" in said and "A prediction" not in said
    assert "Domain: trial 6: inside of what was fitted" in said


def test_inside_is_not_said_of_a_trial_to_which_a_rival_is_nearer(written) -> None:  # type: ignore[no-untyped-def]
    action = model.load_action(written["action"])
    spoiled = action.with_values({"hammer.joint_friction.A": 0.012})  # the set before it was identified is nearer
    result = validation.compare(EXAMPLE, spoiled, **QUICK)
    rows = result.rivals[result.rivals["trial"] == 3]
    assert (rows["nearest"] != "model").any()
    assert not any(line.startswith("Domain:") and "inside" in line for line in result.verdict_lines)
    (nearest,) = (line for line in result.verdict_lines if line.startswith("Nearest:"))
    lost = rows[rows["nearest"] != "model"].iloc[0]
    assert CALLED[lost["nearest"]] in nearest.split(str(lost["channel"]))[1]


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"speed": 1.0, "force": 9.0}, "Domain: trial 3 (largest force"),
        ({"phases": ["strike"]}, "Domain: trial 3 (release: no fitted stroke has it): outside"),
        (None, "Domain: not known"),
    ],
)
def test_a_stroke_unlike_those_fitted_is_said_to_be_outside(written, change, said) -> None:  # type: ignore[no-untyped-def]
    action = model.load_action(written["action"])
    table = dict(action.identification["posterior"])
    strokes = table.pop("strokes")
    if change is not None:
        table["strokes"] = {label: one | change for label, one in strokes.items()}
    other = replace(action, identification={**action.identification, "posterior": table})
    result = validation.compare(EXAMPLE, other, **QUICK)
    assert any(line.startswith(said) for line in result.verdict_lines)
    assert result.outside == (frozenset() if change is None else {1, 2, 3})
    view = SessionView((result,))
    assert ("outside of what was fitted" in trial_words(view, "hammer", 3)) == (change is not None)


def test_the_page_says_in_plain_sentences_what_is_known_and_what_is_not(found, written) -> None:  # type: ignore[no-untyped-def]
    page = written["page"].read_text("utf-8")
    assert "http://" not in page and "https://" not in page
    assert "No value of 1 parameter is identified from 2 trials" in page and as_sentence(PROVISIONAL) in html.unescape(
        page
    )
    assert "Held out, example_forte: hammer speed at impact off by" in page
    assert "joint friction of the hammer (hammer.joint_friction.A)" in page
    assert page.index("No value of 1") < page.index('id="forest"') < page.index('id="provenance"')
    assert all(
        f'id="{part}"' in page
        for part in ("figure-profiles", "figure-residuals", "table-prediction-fit_scores", "provenance")
    )
    assert "No trial was held out" in " ".join(
        plain_sentences(replace(found, events={}, scores={FITTED: found.scores[FITTED]}))
    )
    driven = replace(found, events={})  # held out under the key's motion: curves, no events
    assert "Held out, example_forte, under the measured motion of the key" in " ".join(plain_sentences(driven))


def test_nothing_is_left_half_written(found, tmp_path: Path, monkeypatch) -> None:  # type: ignore[no-untyped-def]
    monkeypatch.setattr("validation.infer.write.render_identification", lambda *given: "a page")
    (tmp_path / "identified.html").mkdir()
    with pytest.raises(ValidationInputError, match="cannot be written"):
        write_reading(found, tmp_path / "identified.toml")
    assert [p.name for p in tmp_path.iterdir()] == ["identified.html"]


@pytest.mark.parametrize("specimen", [{}, SPECIMEN])
def test_derivatives_are_those_of_differences_whatever_the_tangent_does(specimen: dict[str, float]) -> None:
    start = model.load_action("hirschkorn2004", specimen)
    free = unknowns(start, ["hammer.joint_friction"], ["*"])
    trials = collect([EXAMPLE], start, IdentifyOptions(phases=20)).fitted[:1]
    here = np.zeros((1, len(free.moved)))
    (exact,) = ModelResponse(start, free.moved, trials).jacobian(here[0], [0])
    (difference,) = ModelResponse(start, free.moved, trials, 1e-8).differences(here, None, [0], [0])
    assert np.abs(exact - difference).max() < 0.1 * np.abs(difference).max()


def test_sessions_that_cannot_be_used_together_are_refused() -> None:
    with pytest.raises(ValidationInputError, match="given twice"):
        identify([EXAMPLE, EXAMPLE], ["friction"])
    with pytest.raises(ValidationInputError, match="no session given"):
        identify([], ["friction"])
