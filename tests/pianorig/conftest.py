"""What the tests of the command line share."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

FORTE = Path(__file__).parents[1] / "model" / "data" / "forte_force.csv"


@pytest.fixture
def short_force(tmp_path: Path) -> Path:
    """Forty milliseconds of a forte."""
    rows = np.loadtxt(FORTE, delimiter=",", skiprows=1)[400:600]
    path = tmp_path / "force.csv"
    np.savetxt(path, rows, "%.4f", ",", header="time_s,force_n", comments="")
    return path
