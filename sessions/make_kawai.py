"""Make `sessions/kawai_kg3c` of the recording of a real action: import, identification, everything but the text files.

Run:  python sessions/make_kawai.py kawai_kg3c_e4_part1.csv.gz kawai_kg3c_e4_repeated.csv.gz [--out FOLDER]

The recording is gzweigle/Piano-Data, folder kawai_kg-3c_action/hammer_and_damper0, its first 38.46 s as two tables of
time and two readings; README.md of the session says more. The searches are carried
on from the set that is there (`--start`). A quarter of an hour of processor time.
"""

from __future__ import annotations

import argparse
import gzip
import shutil
import tempfile
from pathlib import Path

import rig
from validation.identification.positions import FILE, identify_session, read_identified, write_identified

HOME = Path(__file__).parent / "kawai_kg3c"
FIT_TO = "2,3,5,7,8"
"""Slow press, medium stroke, two fast ones, four of the eight repeated; the slide-off and a fast one are held out."""
ACTION = "hirschkorn2004-regulated"


def main() -> None:
    """Import, identify, put the files in place."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recordings", type=Path, nargs="+", help="The tables, .csv or .csv.gz.")
    parser.add_argument("--mapping", type=Path, default=HOME / "mapping.toml", help="Which column is what.")
    parser.add_argument("--out", type=Path, default=HOME, help="Session folder; its texts stay.")
    parser.add_argument("--start", type=Path, default=HOME / FILE, help="Set that the searches are carried on from.")
    parser.add_argument("--fit", default=FIT_TO, help="Trials to identify on.")
    given = parser.parse_args()
    trials = [int(number) for number in given.fit.split(",")]
    with tempfile.TemporaryDirectory() as temporary:
        made = Path(temporary) / "kawai_kg3c"
        session = rig.import_session(made, given.recordings, rig.load_mapping(given.mapping))
        write_identified(made / FILE, identify_session(session, trials, ACTION, print, read_identified(given.start)))
        _excerpt(given.recordings[0], made / "excerpt.csv")
        given.out.mkdir(parents=True, exist_ok=True)
        for file in made.iterdir():
            shutil.copy(file, given.out / file.name)
    print(f"{given.out}: made, identified on {trials}")


def _excerpt(recording: Path, path: Path) -> None:
    """Write the rows of the last second and a half, an example of a further recording."""
    data = recording.read_bytes()
    lines = (gzip.decompress(data) if recording.suffix == ".gz" else data).decode().splitlines(keepends=True)
    path.write_text("".join([lines[0], *lines[-3000:]]))


if __name__ == "__main__":
    main()
