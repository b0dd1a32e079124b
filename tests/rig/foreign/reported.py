"""Run the recordings of public bug reports through ``pianorig import``: expected beside seen.

    python -m tests.rig.foreign.reported FOLDER

Each folder in it has a README (what it is, ``expected: …``, ``seen: …`` at the time of the report), a recording ``a.*``
and its mapping ``m.toml``. Prints one block each; nothing is judged, the reader compares.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

HOLD = "import h5py, sys, time; f = h5py.File(sys.argv[1], 'r+'); print('open', flush=True); time.sleep(60)"


def lines_of(*arguments: object) -> list[str]:
    """What a command prints, its exit code last."""
    done = subprocess.run([*map(str, arguments)], capture_output=True, text=True, check=False)
    return [*(done.stdout + done.stderr).strip().splitlines(), f"exit {done.returncode}"]


def import_lines(case: Path, out: Path) -> list[str]:
    """What the import of one case prints; of the case of an open file while another program has it open."""
    recording = next(case.glob("a.*"))
    command = sys.executable, "-m", "pianorig", "import", recording, "--mapping", case / "m.toml", "--out", out
    if not case.name.endswith("_locked"):
        return lines_of(*command)
    copy = out.with_suffix(recording.suffix)
    copy.write_bytes(recording.read_bytes())
    holder = subprocess.Popen([sys.executable, "-c", HOLD, str(copy)], stdout=subprocess.PIPE, text=True)
    try:
        assert holder.stdout is not None and holder.stdout.readline()
        return lines_of(*(copy if word is recording else word for word in command))
    finally:
        holder.kill()
        holder.communicate()


def main(folder: Path) -> None:
    """Print all cases of a folder."""
    with tempfile.TemporaryDirectory() as work:
        for case in sorted(path.parent for path in folder.glob("*/README")):
            print(f"== {case.name}")
            print("\n".join(f"   {line}" for line in (case / "README").read_text(encoding="utf-8").splitlines()))
            script = case / "run.sh"
            seen = lines_of("bash", script, work) if script.is_file() else import_lines(case, Path(work) / case.name)
            print("\n".join(f"   now: {line}" for line in seen))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
