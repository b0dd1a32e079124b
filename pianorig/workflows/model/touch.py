"""How several actions feel, drawn and written side by side."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pandas as pd

import model
from model.touch import Feel, feel
from model.touch.figure import draw
from pianorig.console.column_file import write_table


def feel_actions(actions: Sequence[tuple[str, model.Action]], figure: Path | None, curve: Path | None) -> list[Feel]:
    """Touch of each named action; one sheet and one table of the force-dip curves, where files are named."""
    feels = [feel(action, name=name) for name, action in actions]
    if figure is not None:
        draw(feels, figure)
    if curve is not None:
        parts = [
            pd.DataFrame({"action": f.name, "way": way, "dip_m": dip, "force_n": force})
            for f in feels
            for way, (dip, force) in zip(("down", "up"), f.weights.curve(), strict=True)
        ]
        write_table(curve, pd.concat(parts, ignore_index=True))
    return feels
