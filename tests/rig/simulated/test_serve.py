"""A session over TCP, from a bench served in another process."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pianorig.workflows.predict_blow import predictor
from rig import NotPermitted, Permission, load_profile, load_rig, record_session
from rig.selftest import read_record
from rig.simulated.bench.plant import TOLERANCE

STIFFNESS_N_PER_RAD = 3e4
"""Of the pressed felt under the key, per turn of the key: the same blow in ten divisions into blocks differs by up to
8e-7 rad and 0.026 N."""
STEP = Path(__file__).parents[1] / "step.toml"


def test_a_session_recorded_over_tcp_is_the_one_recorded_in_process(serve, permitted_on_a_slow_link, tmp_path) -> None:
    permitted = permitted_on_a_slow_link
    program, address = serve("sim://?seed=5")
    assert address.startswith("ni-grpc://127.0.0.1:")
    rig = load_rig(permitted[1])
    arguments = {"profile": load_profile(STEP), "rig_config": rig, "trials": 2, "predict": predictor(rig)}
    with pytest.raises(NotPermitted):
        record_session(tmp_path / "far", backend=address, **arguments)
    permission = Permission("--yes", rig.sha256, read_record(Path(permitted[4])))
    far = record_session(tmp_path / "far", backend=address, permission=permission, **arguments)
    near = record_session(tmp_path / "near", backend="sim://?seed=5", **arguments)
    assert far.info.simulated and "gRPC Device Server" in far.info.backend["name"]
    for there, here in zip(far.trials, near.trials, strict=True):
        a, b = there.read(), here.read()
        n = min(a.n_valid, b.n_valid)
        assert abs(a.n_valid - b.n_valid) <= 2500  # blocks are longer on a busy machine, and end it later
        for name in ("time_s", "motor_command_v"):
            np.testing.assert_array_equal(getattr(a, name)[:n], getattr(b, name)[:n])
        # the plant is integrated from block to block, which are longer over TCP, most on a busy machine: angles move
        # within their tolerance, and the force by what the felt under the key makes of it
        off_n = TOLERANCE * STIFFNESS_N_PER_RAD
        for name, within in (("force_n", off_n), ("force_raw", off_n / 50), ("encoder_count", 2)):
            np.testing.assert_allclose(getattr(a, name)[:n], getattr(b, name)[:n], rtol=0, atol=within)
        assert np.count_nonzero(a.force_n[:n] != b.force_n[:n]) < 0.1 * n
    assert program.end() == 0
