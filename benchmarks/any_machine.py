"""Does the test suite pass on other processors than this one, and in other states of this machine?

    python -m benchmarks any_machine [--only NAME,A+B,…] [--list] [--keep FOLDER] [-- PYTEST OPTIONS]

Each row runs ``python -m pytest`` once: as another processor would (kernels compiled for it into a cache of their own,
NumPy, BLAS, the C library and OpenCV held to its instructions), or with this machine in another state. A processor
this one cannot stand in for is said and left out. ``--only nehalem+busy`` is one run as that processor in that state.
One run after the other, each with all cores; prints a table in Markdown, and on standard error the tests that failed.
"""

from __future__ import annotations

import os
import platform
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from functools import reduce
from itertools import product
from pathlib import Path

from llvmlite import binding

from benchmarks.runner import ROOT, Run

SSE = ("sse3", "ssse3", "sse4.1", "sse4.2", "popcnt", "cx16")
AVX2 = (*SSE, "avx", "avx2", "fma", "bmi", "bmi2", "lzcnt", "movbe", "f16c")
NO_WIDE = "glibc.cpu.hwcaps=-AVX512F,-AVX512VL,-AVX512BW,-AVX512DQ"
BUSY = "while True: pass"
NOBODY = ("setpriv", "--reuid=65534", "--regid=65534", "--clear-groups")


@dataclass(frozen=True)
class Row:
    """One run of the suite: what its environment adds, options of pytest, and the state it needs."""

    environment: dict[str, str] = field(default_factory=dict)
    options: tuple[str, ...] = ()
    state: str = ""
    needs: tuple[str, ...] = ()

    def beside(self, other: Row) -> Row:
        """Both at once; two states cannot be had."""
        if self.state and other.state:
            sys.exit(f"--only: the states {self.state} and {other.state} cannot be had in one run")
        environment, options = self.environment | other.environment, self.options + other.options
        return Row(environment, options, self.state or other.state, self.needs + other.needs)


def processor(name: str, features: tuple[str, ...], blas: str, threads: int | None = None, **more: str) -> Row:
    """Kernels, BLAS, NumPy, libm and OpenCV of a processor of LLVM's ``name`` with these instructions."""
    wide = "avx2" in features
    environment = {
        "NUMBA_CPU_NAME": name,
        "NUMBA_CPU_FEATURES": ",".join(f"+{one}" for one in features),
        "OPENBLAS_CORETYPE": blas,
        "NPY_DISABLE_CPU_FEATURES": " ".join(numpy_beyond(wide)),
        "GLIBC_TUNABLES": NO_WIDE if wide else f"{NO_WIDE},-AVX2,-FMA,-AVX",
        "OPENCV_CPU_DISABLE": "AVX512-SKX" if wide else "AVX512-SKX,AVX2,AVX",
        **more,
    }
    if threads is not None:
        environment |= {"OPENBLAS_NUM_THREADS": str(threads), "OMP_NUM_THREADS": str(threads)}
    return Row(environment, needs=features)


def numpy_beyond(wide: bool) -> list[str]:
    """NumPy's own names of instructions beyond AVX2, or beyond what it always uses."""
    from numpy._core._multiarray_umath import __cpu_dispatch__ as dispatched  # type: ignore[import-not-found]

    return [name for name in dispatched if not wide or re.search("V4|AVX512", name)]


PROCESSORS = {
    "this processor": Row(),
    "haswell, one BLAS thread": processor("haswell", AVX2, "Haswell", 1),
    "SSE4.2 only (nehalem)": processor("nehalem", SSE, "Nehalem"),
    "znver3, four BLAS threads": processor("znver3", (*AVX2, "adx", "aes", "vaes", "sha"), "Zen", 4),
    "generic x86-64": processor("generic", (), "Nehalem"),
    "this one, BLAS of SkylakeX": Row({"OPENBLAS_CORETYPE": "SkylakeX"}, needs=("avx512f",)),
    "this one, OpenCV without AVX2": Row({"OPENCV_CPU_DISABLE": "AVX2,AVX512"}),
}
STATES = {
    "four busy processes, random order (seed 1)": Row(
        options=("--random-order", "--random-order-seed=1"), state="busy"
    ),
    "one process, random order (seed 2)": Row(options=("-n", "0", "--random-order", "--random-order-seed=2")),
    "Kathmandu, LC_ALL=C, no HOME, path with space and umlaut, -n 2": Row(
        {"TZ": "Asia/Kathmandu", "LC_ALL": "C"}, ("-n", "2"), "moved"
    ),
    "not root, read-only checkout, installed wheel": Row(state="foreign"),
}


def chosen_rows(only: str) -> dict[str, Row]:
    """The rows whose names contain one of the words, all without words; of words joined by ``+`` one row for all."""
    rows, found = {**PROCESSORS, **STATES}, {}
    words = [word.strip() for word in only.split(",") if word.strip()]
    for word in words or [""]:
        for names in product(*([name for name in rows if part.strip() in name] for part in word.split("+"))):
            found[" + ".join(names)] = reduce(Row.beside, (rows[name] for name in names))
    return found


def missing(row: Row) -> str:
    """Why a row cannot be run here; empty if it can."""
    has = binding.get_host_cpu_features()
    lacking = [one for one in row.needs if not has.get(one)]
    if lacking:
        return f"this processor lacks {', '.join(lacking)}"
    if row.state == "foreign":
        asked = [*NOBODY, sys.executable, "-c", "import pytest"]
        if shutil.which(NOBODY[0]) is None or os.getuid() != 0:
            return "only root can become another user, with setpriv"
        if subprocess.run(asked, capture_output=True, cwd="/").returncode:
            return f"another user cannot read {sys.executable} and its packages"
    return ""


@contextmanager
def busy_processes(number: int) -> Iterator[None]:
    """Other work on the machine."""
    others = [subprocess.Popen([sys.executable, "-c", BUSY]) for _ in range(number)]
    try:
        yield
    finally:
        for other in others:
            other.kill()
            other.wait()


def copy_of_the_checkout(folder: Path) -> Path:
    """The files that git knows, in another place."""
    names = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    for name in filter(None, names.split("\0")):
        if (ROOT / name).is_file():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, folder / name)
    return folder


def installed(folder: Path, *what: str) -> Path:
    """The interpreter of a new environment beside this one's packages, with the project installed."""
    subprocess.run([sys.executable, "-m", "venv", "--system-site-packages", folder], check=True)
    python = folder / "bin" / "python"
    # an environment made from another environment sees the interpreter's packages, not the other's
    own = [p for p in sys.path if p.endswith("site-packages") and Path(p).is_dir()]
    site = next((folder / "lib").glob("python*/site-packages"))
    (site / "outer.pth").write_text("\n".join(own) + "\n", encoding="utf-8")
    subprocess.run([python, "-m", "pip", "install", "--quiet", "--no-deps", *what], check=True)
    return python


def run(row: Row, extra: list[str]) -> tuple[str, int, float]:
    """The output of one run of the suite, its exit code, and its seconds."""
    with ExitStack() as stack:
        # not below the checkout, and open to a user who is not root
        work = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="any_machine_")))
        work.chmod(0o755)
        environment = {**os.environ, "PIANORIG_CACHE_DIR": str(work / "kernels"), **row.environment}
        command, folder = [sys.executable, "-m", "pytest", "-q", *row.options, *extra], ROOT
        if row.state == "busy":
            stack.enter_context(busy_processes(4))
        if row.state == "moved":
            folder = copy_of_the_checkout(work / "Hörsaal 3" / "piano action")
            command[0] = str(installed(work / "venv", "-e", str(folder)))
            for found in (work / "venv").glob("lib/python*/site-packages/*piano*.pth"):
                found.unlink()  # Python does not start under LC_ALL=C where one names a path with an umlaut
            environment["PYTHONPATH"] = str(folder)
            environment.pop("HOME", None)
        if row.state == "foreign":
            folder = copy_of_the_checkout(work / "checkout")
            wheels = work / "wheels"
            subprocess.run(
                [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "-w", wheels, folder], check=True
            )
            command[0] = str(installed(work / "venv", str(next(wheels.glob("*.whl")))))
            writable = work / "scratch"
            writable.mkdir()
            writable.chmod(0o777)
            environment |= {"PIANORIG_CACHE_DIR": str(writable / "kernels"), "HOME": str(writable)}
            environment |= {"TMPDIR": str(writable), "PYTHONDONTWRITEBYTECODE": "1"}
            subprocess.run(["chmod", "-R", "a-w,a+rX", folder], check=True)
            stack.callback(subprocess.run, ["chmod", "-R", "u+w", folder], check=True)
            command = [*NOBODY, *command]
        start = time.perf_counter()
        done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)
        return done.stdout + done.stderr, done.returncode, time.perf_counter() - start


def main(asked: Run) -> bool:
    """Run the rows asked for and print their table; whether all pass."""
    rows = chosen_rows("" if asked.list else asked.only)
    if asked.list or not rows:
        print("\n".join([*PROCESSORS, *STATES]))
        return asked.list or sys.exit("--only: no row has such a name; the names are above")
    print(f"{platform.processor() or platform.machine()} ({binding.get_host_cpu_name()}), {os.cpu_count()} cores\n")
    print("| processor or state | result | seconds |\n|---|---|---:|", flush=True)
    good = True
    for name in rows:
        if why := missing(rows[name]):
            print(f"| {name} | not run: {why} | |", flush=True)
            continue
        said, code, seconds = run(rows[name], asked.rest)
        last = re.findall(r"^(?:=+ )?(\d+ (?:passed|failed|error|deselected).*?)(?: in [\d.]+s.*)?$", said, re.M)
        result = f"{last[-1] if last else 'no result'}{f', exit code {code}' if code > 1 else ''}"
        print(f"| {name} | {result} | {seconds:.0f} |", flush=True)
        if code:
            good = False
            failed = re.findall(r"^(?:FAILED|ERROR) .*$", said, re.M) or said.splitlines()[-20:]
            print(f"\n{name}:", *failed, sep="\n  ", file=sys.stderr, flush=True)
            if asked.keep:
                Path(asked.keep).mkdir(parents=True, exist_ok=True)
                kept = Path(asked.keep) / f"{re.sub(r'[^A-Za-z0-9.]+', '_', name)}.txt"
                kept.write_text(said, encoding="utf-8")
    return good
