"""Rest state: against the published balance, under load, and for actions that differ from the printed one."""

from __future__ import annotations

import numpy as np
import pytest

import model
from model.verification.reference_equations import Twin

# Static balance of the printed parameters, found independently by two implementations (hand-written
# Newton-Euler, symbolic Lagrange), residual < 3e-14 N m; project note model.md, rest_state.json.
REST = [0.028600363768885056, 0.025109511260139862, 0.31975495900647877, 0.3523367185735365, 0.2950879163697746]
LOADED = {
    "contact01": 0.8107367073071615, "contact03": 0.16583632333201143, "contact05": 0.1100818121289008,
    "contact06": 1.1387309386691051, "contact07": 0.41177955991788406, "contact13": 0.03905360523296049,
}  # fmt: skip


def test_rest_state_of_the_printed_action(action: model.Action) -> None:
    rest = model.rest_state(action)
    np.testing.assert_allclose(rest.angle_rad, REST, rtol=0, atol=1e-9)
    forces = dict(zip(rest.contacts, rest.contact_normal_n, strict=True))
    for name, force in forces.items():
        assert force == pytest.approx(LOADED.get(name, 0.0), abs=1e-8), name
    assert rest.residual_nm < 1e-12
    height = model.observables.hammer_height_m(action, rest.angle_rad[None])[0]
    assert height == pytest.approx(48.15659994532259e-3, abs=1e-9)


@pytest.mark.parametrize("force", [-0.1, 0.3, 10.0, 60.0])
def test_rest_under_load_balances_the_twin(action: model.Action, twin: Twin, force: float) -> None:
    rest = model.rest_state(action, force)
    residual, _ = twin.forces_and_mass(rest.angle_rad, np.zeros(5), force)
    assert np.abs(residual).max() < 1e-10


def test_rest_of_other_actions(action: model.Action) -> None:
    random = np.random.default_rng(7)
    lengths = [p for p, q in action.quantities.items() if q.unit == "m" and not p.endswith("radius")]
    for _ in range(15):
        moved = action.with_values({p: action[p] + random.uniform(-5e-4, 5e-4) for p in lengths})
        rest = model.rest_state(moved)
        residual, _ = Twin(moved).forces_and_mass(rest.angle_rad, np.zeros(5), 0.0)
        assert np.abs(residual).max() < 1e-10


def test_without_hammer_rest_the_hammer_lies_on_the_knuckle(action: model.Action) -> None:
    rest = model.rest_state(action.with_values({"contact13": 0}))
    forces = dict(zip(rest.contacts, rest.contact_normal_n, strict=True))
    assert "contact13" not in forces
    assert forces["contact07"] > LOADED["contact07"]


def test_input_must_be_finite(action: model.Action) -> None:
    with pytest.raises(model.InputError, match="finite"):
        model.rest_state(action, float("nan"))
