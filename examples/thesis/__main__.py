"""What the thesis observed and left open, on an action of yours: four parts, minutes together.

Run:  python examples/thesis [PART ...] [--action ACTION] [--out FOLDER]

observations    the 22 statements of Sections 4.2.2 and 4.4, each a check with a number
friction-limit  the smoothed friction of eq. 2.10 at falling threshold speeds beside set-valued friction
equal-loss      laws of felt with memory at the peak force and the loss of the thesis's law
string          the rigid bar beside a string and a choir

Without a PART all of them. The forte is the built-in one that each part names; the numbers go into FOLDER/PART.json.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import equal_loss
import friction_limit
import observations
import string_blow

import model

PARTS = {
    "observations": (observations.run, "thesis-forte"),
    "friction-limit": (friction_limit.run, "thesis-forte"),
    "equal-loss": (equal_loss.run, "forte"),
    "string": (string_blow.run, "forte"),
}

parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
parser.add_argument("part", nargs="*", choices=[[], *PARTS], metavar="PART", help=", ".join(PARTS))
parser.add_argument("--action", default="hirschkorn2004", help="built-in action or a TOML file")
parser.add_argument("--out", type=Path, help="folder for the numbers")
given = parser.parse_args()
for part in given.part or PARTS:
    run, blow = PARTS[part]
    lines, numbers = run(model.load_action(given.action), *model.force_table(blow))
    print("\n".join(lines), end="\n\n", flush=True)
    if given.out is not None:
        given.out.mkdir(parents=True, exist_ok=True)
        (given.out / f"{part}.json").write_text(json.dumps(numbers, indent=1))
