"""The local table: its arithmetic on a blow, its order, its figures."""

from __future__ import annotations

import numpy as np
import pytest

import model
from model.sensitivity import local_table
from model.sensitivity.local_table import lines

NAMES = ("friction", "hammer.mass", "contact02")


@pytest.fixture(scope="module")
def found(action: model.Action) -> model.Sensitivities:
    return model.sensitivities(action, model.force_table("forte"), NAMES)


def test_percent_per_percent(found: model.Sensitivities) -> None:
    table = local_table(found)
    i, q = table.parameters.index("hammer.mass"), table.quantities.index("strike_m_per_s")
    j = NAMES.index("hammer.mass")
    slope = found.d_events["strike_m_per_s"][j]
    assert table.percent[i, q] == pytest.approx(slope * found.values[j] / found.events["strike_m_per_s"])
    assert table.change[i, q] == pytest.approx(0.01 * slope * found.values[j])
    assert table.per_u[i, q] == pytest.approx(slope * found.uncertainties[j])
    assert np.isnan(table.per_u[table.parameters.index("friction"), q])  # a factor has no declared uncertainty
    late = table.quantities.index("strike_s")
    assert table.values[late] == pytest.approx(found.events["strike_s"] - found.events["onset_s"])


def test_one_uncertainty_of_a_value_that_is_zero_or_negative(action: model.Action) -> None:
    """A percent of it is nothing, or moves it the other way; an uncertainty is neither."""
    found = model.sensitivities(action, model.force_table("forte"), ["key.pivot.y", "whippen.pivot.x", "hammer.mass"])
    assert found.values[0] == 0.0 > found.values[1]
    table = local_table(found)
    for j, name in enumerate(found.parameters):
        i = table.parameters.index(name)
        for event in ("strike_m_per_s", "let_off_m"):
            expected = found.d_events[event][j] * found.uncertainties[j]
            assert expected != 0.0 and table.per_u[i, table.quantities.index(event)] == pytest.approx(expected)
        assert table.per_u[i, table.quantities.index("hammer curve")] > 0.0
        assert table.percent[i, table.quantities.index("hammer curve")] >= 0.0
    assert table.parameters[0] != "key.pivot.y"


def test_a_curve_changes_as_a_second_run_does(action: model.Action, found: model.Sensitivities) -> None:
    table = local_table(found)
    q = table.quantities.index("hammer curve")
    step = 1e-4
    ends = [
        model.simulate(
            model.scale_parameters(action, {"friction": 1.0 + s * step}), *model.force_table("forte"), tolerance=1e-9
        )
        for s in (1.0, -1.0)
    ]
    turns = [end.angle_rad[:, 4] - end.angle_rad[0, 4] for end in ends]
    change = np.sqrt(np.mean((turns[0] - turns[1]) ** 2)) / (2.0 * step) / np.sqrt(np.mean(turns[0] ** 2))
    assert table.percent[table.parameters.index("friction"), q] == pytest.approx(change, rel=1e-2)


def test_ranked_by_the_largest_effect_and_printed(found: model.Sensitivities) -> None:
    table = local_table(found)
    largest = np.max(np.abs(table.percent), axis=1)
    assert np.all(np.diff(largest) <= 0.0) and {*table.parameters} == {*NAMES}
    text = lines(table, {"strike_m_per_s": "speed", "not there": "x"}, 2)
    assert len(text) == 3 and text[0].split() == ["parameter", "speed"]
    assert len(table.rows()) == len(table.parameters) * len(table.quantities)
