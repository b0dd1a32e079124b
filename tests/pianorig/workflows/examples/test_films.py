"""The example film shows the blow that the model computed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import model
from pianorig.workflows import examples as films


def test_the_camera_gets_the_angles_of_the_model(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whippen from ground, jack and repetition lever from the whippen, in motion and at rest."""
    given: dict[str, Any] = {}

    def camera(path: Path, times: Any, angles_at: Any, geometry: Any, *more: Any, **options: Any) -> None:
        given.update(times=times, angles=angles_at(times), geometry=geometry)

    monkeypatch.setattr(films, "film_trial", camera)
    table_s, force_n = model.force_table("forte")
    blow = model.simulate(model.load_action(), table_s[:801], force_n[:801])
    films.write_blow_film(tmp_path / "film.mraw", tmp_path / "bodies.toml", blow)
    inside = given["times"] < table_s[800]
    for k, body in enumerate(("whippen", "jack", "repetition")):
        wanted = np.interp(given["times"], blow.time_s, blow.angle_rad[:, model.BODIES.index(body)])
        np.testing.assert_allclose(given["angles"][inside, k], wanted[inside], atol=1e-12, err_msg=body)
    rest = model.rest_state(model.load_action()).angle_rad
    assert given["geometry"].rest_angle_rad == pytest.approx(tuple(rest[1:4]), abs=1e-6)
