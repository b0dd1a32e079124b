"""What the tests of the command line share."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

FORTE = Path(__file__).parents[1] / "model" / "data" / "forte_force.csv"


@pytest.fixture
def short_force(tmp_path: Path) -> Path:
    """Forty milliseconds of a forte."""
    rows = np.loadtxt(FORTE, delimiter=",", skiprows=1)[400:600]
    path = tmp_path / "force.csv"
    np.savetxt(path, rows, "%.4f", ",", header="time_s,force_n", comments="")
    return path


@pytest.fixture
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Figures are laid out and their files written, but nothing is drawn into them, which takes most of a command."""

    def save(figure: Figure, file: Path, **options: object) -> None:
        Path(file).write_text("laid out")

    monkeypatch.setattr(Figure, "savefig", save)
