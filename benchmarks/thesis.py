"""What the thesis observed and left open, by `examples/thesis`: counts, limits and matches as one table a part.

Until the release the smoothed friction has to come nearer to set-valued friction with each smaller threshold speed,
down to what the steps themselves are off; later a motion may part from another by any small difference. Laws of felt
have to meet peak and loss of the thesis's law on hammer and back check.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from pathlib import Path

from benchmarks.runner import ROOT, Run

PARTS = ("observations", "friction-limit", "equal-loss")
NEAR = 0.05  # difference at the smallest threshold speed, as a share of that at the largest
CLOSE = 0.08  # of peak and loss: the back check's memory meets them within this


def main(run: Run) -> bool:
    """Run the parts asked for; whether friction converges and the laws are matched."""
    right = True
    with tempfile.TemporaryDirectory() as folder:
        line = [sys.executable, str(ROOT / "examples" / "thesis"), *run.part, "--action", run.action, "--out", folder]
        print(subprocess.run(line, cwd=ROOT, check=True, capture_output=True, text=True).stdout)
        found = {part: json.loads(Path(folder, f"{part}.json").read_text()) for part in run.part}
    if "friction-limit" in found:
        *away, limit = (row["differs_until_release_rad"] for row in found["friction-limit"]["rows"])
        right &= all(a > b for a, b in zip(away, away[1:], strict=False)) and limit == 0.0
        right &= away[-1] < NEAR * away[0]
        right &= found["friction-limit"]["error_rad"] < away[-1]
    if "equal-loss" in found:
        rows = [row for row in found["equal-loss"]["rows"] if row["felts"] in ("hammer", "back check")]
        for base, *others in (rows[:3], rows[3:]):
            for row in others:
                right &= all(abs(row[name] / base[name] - 1.0) < CLOSE for name in ("peak_n", "loss_mj"))
    return right
