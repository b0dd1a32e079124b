"""Does recording what `identify` recommends shrink the intervals as it predicts? On the virtual bench, from end to end.

    python benchmarks/record_next.py [--asked friction,joint_friction] [--fixed "*"] [--first forte] [--trials 5]
                                     [--top 2] [--known] [--folder FOLDER]

A session is recorded and identified; every stroke on the shelf is ranked; the best ones and the worst are recorded as
their plan says, and the identification is made again with both sessions. Printed: u of every parameter over what it
was, predicted and realised, and how many of them are within 20 % of each other. With ``--folder`` what was recorded is
kept and used again. ``--known``: what is not asked for is held at the specimen's own values, so that the model lacks
only what the bench has beside it (motor arm, sensors); without it the printed values are wrong by up to 60 %, the
discrepancy is large, and what a second stroke teaches about its size is not predicted.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import model
import rig
import validation
from benchmarks.bench_strokes import BENCH
from pianorig.workflows.model.next_strokes import next_strokes
from rig.configuration.rig_file import load_rig
from rig.simulated.bench.plant import load_plant
from validation.identification.further import write_plan
from validation.identification.unknowns import unknowns

NEAR = 0.2


def recorded(folder: Path, **what: object) -> Path:
    """A session on the virtual bench; one that is there already is taken."""
    if not (folder / "session.toml").is_file():
        rig.record(folder, backend="sim://", operator="benchmark", **what)  # type: ignore[arg-type]
    return folder


def start_action(asked: list[str]) -> model.Action:
    """The built-in action with the specimen's values of all that is not asked for."""
    printed, specimen = model.load_action(), load_plant(BENCH, 0, 5000.0).action
    free = {path for p in unknowns(printed, asked, ("*",)).asked for path in p.paths}
    other = {path: specimen[path] for path in printed.quantities if path not in free}
    return printed.with_values({path: value for path, value in other.items() if value != printed[path]})


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--asked", default="friction,joint_friction")
    parser.add_argument("--fixed", default="*", help="held parameters; empty for none")
    parser.add_argument("--first", default="forte")
    parser.add_argument("--trials", type=int, default=5)
    parser.add_argument("--top", type=int, default=2)
    parser.add_argument("--known", action="store_true")
    parser.add_argument("--folder", type=Path)
    options = parser.parse_args()
    folder = options.folder or Path(tempfile.mkdtemp())
    folder.mkdir(exist_ok=True)
    free = {"fixed": tuple(filter(None, options.fixed.split(","))), "profiles": ()}
    first = recorded(folder / "first", profile=options.first, trials=options.trials)
    start = start_action(options.asked.split(",")) if options.known else model.load_action()
    before = validation.identify([first], options.asked.split(","), start, **free)
    ranked, refused = next_strokes(before, load_rig("virtual"), options.trials)
    for line in refused:
        print(f"not considered: {line}")
    for p in ranked:
        print(f"{p.mean:.3f}  {p.name}")
    strokes = [p for p in ranked if p.candidate is not None and p.candidate.profile is not None]
    u_before = np.sqrt(np.diag(before.details.fitted.covariance))
    near = total = 0
    for p in [*strokes[: options.top], *strokes[options.top :][-1:]]:
        assert p.candidate is not None and p.candidate.profile is not None
        name = p.candidate.profile.name.replace(" ", "_")
        files = write_plan([p], folder / f"{name}.toml")
        second = recorded(folder / name, plan=rig.load_plan(files[f"{name}.toml"]))
        after = validation.identify([first, second], options.asked.split(","), start, **free)
        u_after = np.sqrt(np.diag(after.details.fitted.covariance))
        print(f"\n{p.name}: u after over u before, predicted and realised")
        for j, e in enumerate(after.estimates):
            realised = float(u_after[j] / u_before[j])
            near += abs(realised / p.shrink[e.name] - 1) <= NEAR
            total += 1
            off = 100 * (realised / p.shrink[e.name] - 1)
            print(f"  {e.name:28s} {p.shrink[e.name]:6.3f} {realised:6.3f} {off:+6.0f} %")
    print(f"\nwithin {NEAR:.0%} of predicted: {near} of {total}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
