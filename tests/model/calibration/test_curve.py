"""Loading experiments as files: what is read, what is refused and in which words."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from model import InputError
from model.calibration import read_curve

IN = [(k * 1e-4, 0.5 * k) for k in range(11)]
OUT = [(k * 1e-4, 0.3 * k) for k in range(10, -1, -1)]


def text(rows: list[tuple[float, float]], header: str = "displacement_m,force_n") -> str:
    return header + "\n" + "".join(f"{x!r},{f!r}\n" for x, f in rows)


def test_turns_at_the_largest_displacement(tmp_path: Path) -> None:
    (tmp_path / "c.csv").write_text(text(IN + OUT))
    curve = read_curve(tmp_path / "c.csv")
    assert len(curve.loading_m) == 11 and len(curve.unloading_m) == 11
    assert curve.loading_n[5] == 2.5 and curve.unloading_n[5] == 1.5
    assert np.all(np.diff(curve.unloading_m) > 0)
    assert curve.shared_m == (0.0, 1e-3)


def test_phase_column_decides(tmp_path: Path) -> None:
    rows = "".join(f"{f},{x},loading\n" for x, f in IN) + "".join(f"{f},{x}, unloading\n" for x, f in OUT)
    (tmp_path / "c.csv").write_text("force_n,displacement_m,phase\n" + rows)
    curve = read_curve(tmp_path / "c.csv")
    assert curve.loading_n[5] == 2.5 and curve.unloading_n[5] == 1.5


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (text(IN), "found one phase only (loading)"),
        (text(OUT), "found one phase only (unloading)"),
        (text(IN + OUT[:4]), "unloading: found 4 points, allowed at least 8"),
        (text(IN[:5] + [(2e-4, 1.0)] + IN[5:] + OUT), "row 6: displacement is not monotone in loading"),
        (text([*IN[:3], (float("nan"), 1.0), *IN[3:], *OUT]), "row 4: displacement_m found nan"),
        (text([(x, -f) for x, f in IN + OUT]), "largest force found -0 N, allowed above 0; check the sign"),
        (text(IN + [(x + 9e-4, f) for x, f in OUT[:0]]), "one phase only"),
        (text(IN + OUT, "x_mm,force_n"), "columns found x_mm,force_n; allowed displacement_m,force_n"),
        (text(IN + OUT) + "0.1,two\n", "row 23: force_n found 'two', allowed a number"),
        (text(IN + OUT) + "0.1\n", "row 23: found 1 cells, allowed 2"),
        ("", "is empty"),
    ],
)
def test_refused_in_one_line(tmp_path: Path, content: str, words: str) -> None:
    (tmp_path / "c.csv").write_text(content)
    with pytest.raises(InputError) as refused:
        read_curve(tmp_path / "c.csv")
    assert words in str(refused.value) and "\n" not in str(refused.value) and "c.csv" in str(refused.value)


def test_phases_that_do_not_overlap(tmp_path: Path) -> None:
    rows = "".join(f"{x},{f},loading\n" for x, f in IN) + "".join(f"{x + 8e-4},{f},unloading\n" for x, f in OUT)
    (tmp_path / "c.csv").write_text("displacement_m,force_n,phase\n" + rows)
    with pytest.raises(InputError, match="share displacements from 0.0008 to 0.001"):
        read_curve(tmp_path / "c.csv")
