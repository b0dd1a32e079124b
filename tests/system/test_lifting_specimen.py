"""A specimen whose key lifts and whose shank bends: what the validation marks is what really happened."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import validation
from rig import Session, load_rig, open_backend
from rig import record as record_session
from rig.simulated import PlantTruth


def test_marked_intervals_are_the_true_lifts(tmp_path: Path) -> None:
    rig = load_rig("virtual")
    bench = open_backend("sim://?effects=balance_rail,shank", rig.config)
    truth: dict[int, PlantTruth] = {}
    record_session(
        tmp_path / "session",
        profile="forte",
        rig_config=rig,
        backend=bench,
        trials=2,
        after_trial=lambda trial: truth.__setitem__(trial.number, bench.plant.truth()),
    )
    bench.close()
    session = Session.open(tmp_path / "session")
    assert session.info.simulated
    quick = {"keep_predictions": False, "rivals": (), "budget": False, "explain": False}
    marked = validation.compare(session, "hirschkorn2004", **quick).marked
    for number, what in truth.items():
        lift, time = what.column("key_lift"), what.time_s
        rows = marked[marked["trial"] == number]
        assert len(rows) >= 1 and set(rows["channel"]) == {"key"}
        for row in rows.itertuples():
            # within a felt's press of 0.1 mm and the edges' resolution of the validation
            inside = (time > row.start_s - 2e-3) & (time < row.end_s + 2e-3)
            assert lift[inside].max() > 5e-5
            assert 0.5 < row.lift_m / lift[inside].max() < 1.2
        high = time[lift > 1.5e-4]
        covered = np.zeros(high.size, dtype=bool)
        for row in rows.itertuples():
            covered |= (high >= row.start_s - 5e-4) & (high <= row.end_s + 5e-4)
        assert high.size > 5 and covered.all()
