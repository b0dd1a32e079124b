"""Size, time and memory of the report against the number of trials: `python -m benchmarks report [--trials 200]`.

Sessions are made from the shipped example: its trials are copied in turn, with the force of each copy slightly scaled.
Film tracking is not included.  Each run is a separate `pianorig validate` process, as started by a user; memory is the
largest resident set of that process and its children.

Cold: a new process with nothing computed for this session.  The kernels' machine code is on disk from an uncounted run
on another session: an installation compiles once (about 20 s), not once per session.  Processor time counts both
processors and depends on other load less than wall time does; the limit of the many trials is one of processor time.
Last, one trial is added to them: the line below the row counts what was computed again.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.runner import ROOT, Run, Table
from rig.session import Session

EXAMPLE = ROOT / "sessions" / "example_forte"
SEED = 100
SCATTER = 0.005
LIMITS = {  # name → (seconds, MB of page, GB of memory)
    "cold": (6.0, 5.0, 0.6),
    "unchanged": (1.5, 5.0, 0.6),
    "rejected": (6.0, 5.0, 0.6),
    "many": (60.0, 5.0, 0.6),
    "added": (60.0, 5.0, 0.6),
}
BY_PROCESSOR_TIME = ("many", "added")
# runs in a separate process, so that the largest resident set belongs to this run alone
RUN = """
import json, resource, subprocess, sys, time
start = time.perf_counter()
done = subprocess.run(
    [sys.executable, "-c", "from pianorig.cli import main; main()", "validate", "--json", sys.argv[1]],
    capture_output=True, text=True,
)
seconds = time.perf_counter() - start
use = resource.getrusage(resource.RUSAGE_CHILDREN)
found = {"code": done.returncode, "out": done.stdout, "err": done.stderr}
print(json.dumps(found | {"s": seconds, "cpu_s": use.ru_utime + use.ru_stime, "kb": use.ru_maxrss}))
"""


def make_session(folder: Path, n_trials: int) -> Path:
    """Make a session of many trials: the example's, copied in turn with slightly scaled force."""
    source = Session.open(EXAMPLE)
    session = Session.create(folder, source.info)
    originals = [trial.read() for trial in source.trials]
    random = np.random.default_rng(SEED)
    for i in range(n_trials):
        trial = originals[i % len(originals)]
        factor = 1 + SCATTER * random.standard_normal()
        session.add_trial(replace(trial, number=i + 1, force_n=trial.force_n * factor))
    return folder


def validate(folder: Path) -> dict[str, Any]:
    """Run ``pianorig validate`` once: seconds, memory, and its output."""
    done = subprocess.run([sys.executable, "-c", RUN, str(folder)], capture_output=True, text=True, check=True)
    result: dict[str, Any] = json.loads(done.stdout)
    if result["code"] != 0:
        raise SystemExit(f"validate failed: {result['err']}")
    return result


def main(run: Run) -> bool:
    """Print the table; whether the limits are met."""
    n_many, met = run.trials, True
    heads = "time s:.2f", "limit:.1f", "processor s:.2f", "memory GB:.3f", "limit:.1f", "page MB:.2f", "limit:.1f"
    table = Table("session:28s", *heads)
    with tempfile.TemporaryDirectory() as place:
        few, many = (make_session(Path(place) / name, n) for name, n in (("few", 5), ("many", n_many)))
        validate(make_session(Path(place) / "compiles", 1))
        for name, folder, title in (
            ("cold", few, "5 trials, cold"),
            ("unchanged", few, "5 trials, unchanged"),
            ("rejected", few, "5 trials, one rejected"),
            ("many", many, f"{n_many} trials, cold"),
            ("added", many, f"{n_many} trials and one more"),
        ):
            if folder == many and not n_many:
                continue
            if name == "rejected":
                Session.open(folder).annotate(4, "reject", "for the benchmark")
            if name == "added":
                session = Session.open(folder)
                trial = session.trials[0].read()
                session.add_trial(replace(trial, number=n_many + 1, force_n=1.001 * trial.force_n))
            result = validate(folder)
            n = n_many + (name == "added") if folder == many else 5 - (name == "rejected")
            said = json.loads(result["out"])
            if f"against {n} trials" not in said["verdict"]:
                raise SystemExit(f"{title}: not all trials were compared: {said['verdict'][:200]}")
            (most_s, most_mb, most_gb), gigabytes = LIMITS[name], result["kb"] * 1024 / 1e9
            page_mb = (folder / "report.html").stat().st_size / 1e6
            taken = result["cpu_s"] if name in BY_PROCESSOR_TIME else result["s"]
            met &= taken <= most_s and page_mb <= most_mb and gigabytes <= most_gb
            table.row(title, result["s"], most_s, result["cpu_s"], gigabytes, most_gb, page_mb, most_mb)
            print(f"  reused: {said['reused']}", flush=True)
    print("all limits met" if met else "NOT all limits met")
    return met
