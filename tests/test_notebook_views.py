"""Results in a notebook show a table of what a reader looks for first, and nothing that could be markup of a file."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import model
import rig

SHIPPED = Path(__file__).parents[1] / "sessions" / "example_forte"


def cells(shown: object) -> list[str]:
    view = shown._repr_html_()  # type: ignore[attr-defined]
    assert view.count("<table") == 1 and "np.float64" not in view
    return re.findall(r"<t[dh]>(.*?)</t[dh]>", view)


def test_a_solution_shows_each_body_in_degrees() -> None:
    solution = model.simulate(model.load_action(), *model.force_table("forte"), estimate_error=True)
    assert "key" in cells(solution) and len(repr(solution)) < 200 and "3501 rows" in repr(solution)
    row = cells(solution)[cells(solution).index("hammer") :][:4]
    degrees = 57.29578 * solution.angle_rad[:, 4]
    assert [float(value) for value in row[1:]] == pytest.approx([degrees[0], degrees.min(), degrees.max()], abs=1e-3)
    bent = model.simulate(model.load_action(), [0.0, 0.01], [0.0, 0.0], scene="lifting-key-flexible-shank")
    assert "mm" in cells(bent)  # the lift is a length


def test_a_regulation_a_touch_and_a_study_show_their_rows() -> None:
    action = model.load_action("hirschkorn2004-regulated")
    assert {"let-off", "button", "1.000"} <= set(cells(model.regulation.regulate(action)))
    dry = model.study.Variant("dry", factors={"damping": 0.1})
    study = model.study.compare(action, *model.force_table("forte"), [dry])
    assert {"as given", "dry", "strike_m_per_s"} <= set(cells(study))


def test_a_session_shows_its_trials(tmp_path: Path) -> None:
    session = rig.Session.open(SHIPPED)
    assert cells(session).count("complete") == 3
    odd = tmp_path / "<b>odd"
    odd.mkdir()
    (odd / "session.toml").write_bytes((SHIPPED / "session.toml").read_bytes())
    assert "<b>" not in rig.Session.open(odd, require_trials=False)._repr_html_()
