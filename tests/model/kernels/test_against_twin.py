"""The compiled kernels agree with the plain NumPy twin, and their derivatives with differences of the twin."""

from __future__ import annotations

import numpy as np
import pytest

import model
from model.derived.columns import FRICTION, NORMAL
from model.derived.observe import contacts_at
from model.kernels import layout as L
from model.scene.build import build_scene
from model.scene.selection import SceneChoice
from tests.model.conftest import random_states
from tests.model.kernels.linearised import Evaluation
from tests.model.verification.reference_equations import Twin


def test_accelerations_equal_the_twin(action: model.Action, twin: Twin) -> None:
    scene = build_scene(action)
    touched = set()
    for q, v, u in random_states(300, seed=1):
        ours = Evaluation(scene, q, v, u).a
        theirs = twin.acceleration(q, v, u)
        touched |= {c for c in twin.contacts if twin.gap(c)[0] > 0}
        np.testing.assert_allclose(ours, theirs, rtol=1e-10, atol=1e-12 * np.max(np.abs(theirs)))
    # the random states exercise nearly every contact; the jack's stop and the string among them
    assert len(touched) >= 11, sorted(touched)


def test_each_contact_force_equals_the_twin(action: model.Action, twin: Twin) -> None:
    scene = build_scene(action)
    for q, v, _ in random_states(100, seed=2):
        ours = contacts_at(scene.tables, scene.vector, q[None], v[None])[0]
        twin._place(q, v)
        for c, name in enumerate(scene.contacts):
            normal, tangential, _ = twin.contact(name, v)
            np.testing.assert_allclose(ours[c, [NORMAL, FRICTION]], (normal, tangential), rtol=1e-9, atol=1e-10)


@pytest.mark.parametrize("effects", [(), ("motor_arm",)])
def test_jacobian_equals_central_differences(action: model.Action, effects: tuple[str, ...]) -> None:
    stiffening = action.with_effects({"motor_arm.contact_a": 1e9, "motor_arm.contact_b": 1e7})
    scene = build_scene(stiffening, SceneChoice(effects=effects))
    n = scene.size
    h = 1e-7
    worst = 0.0
    for q, v, u in random_states(40, seed=3):
        if effects:
            q, v, u = np.append(q, -0.02), np.append(v, 0.3), 0.01 * u
        at = Evaluation(scene, q, v, u)
        for j in range(n):
            e = np.zeros(n)
            e[j] = h
            plus, minus = Evaluation(scene, q + e, v, u), Evaluation(scene, q - e, v, u)
            if plus.touching != minus.touching:
                continue  # a contact opens inside the difference: no derivative there
            # K = df/dq - (dM/dq) a
            stiff = (plus.f - minus.f - (plus.mass - minus.mass) @ at.a) / (2 * h)
            scale = 1e-3 + np.abs(at.stiff).max()
            worst = max(worst, np.abs(stiff - at.stiff[:, j]).max() / scale)
            plus, minus = Evaluation(scene, q, v + e, u), Evaluation(scene, q, v - e, u)
            damp = (plus.f - minus.f) / (2 * h)
            worst = max(worst, np.abs(damp - at.damp[:, j]).max() / (1e-3 + np.abs(at.damp).max()))
        f_u = (Evaluation(scene, q, v, u + 1e-3).f - Evaluation(scene, q, v, u - 1e-3).f) / 2e-3
        np.testing.assert_allclose(f_u, at.f_u, atol=1e-6)
    assert worst < 2e-5


def test_switched_off_elements_leave_the_scene(action: model.Action) -> None:
    full = build_scene(action)
    less = build_scene(action.with_values({"contact12": 0, "jack_spring": 0}))
    assert "contact12" not in less.contacts
    assert len(less.contacts) == len(full.contacts) - 1
    assert len(less.tables.spring) == len(full.tables.spring) - 1
    assert less.vector.size == full.vector.size - L.CONTACT_SIZE - L.SPRING_SIZE


def test_changing_a_value_changes_no_table(action: model.Action) -> None:
    a, b = build_scene(action), build_scene(action.with_values({"contact04.friction.A": 0.2}))
    for x, y in zip(a.tables, b.tables, strict=True):
        np.testing.assert_array_equal(x, y)
    assert np.count_nonzero(a.vector != b.vector) == 1
