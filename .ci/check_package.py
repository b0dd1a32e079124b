"""Compare sdist and wheel with the checkout: nothing missing that a program reads, nothing that is not for users.

Run:  python .ci/check_package.py DIST
"""

from __future__ import annotations

import re
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

ROOT = Path(__file__).parents[1]
PACKAGES = ("model", "vision", "rig", "validation", "pianorig")
SHIPPED = ("sessions/planted_faults/", "sessions/kawai_kg3c/")  # of `pianorig examples`, inside pianorig
NOT_FOR_USERS = re.compile(
    r"^(benchmarks|docs|examples|sessions|\.ci)/|(^|/)(tests?|__pycache__)/|\.(pyc|nbi|nbc|log)$"
)
IN_SDIST = (
    "README.md",
    "LICENSE",
    "CHANGELOG.md",
    "CITATION.cff",
    "pyproject.toml",
    "docs/index.md",
    "tests/conftest.py",
)


def tracked() -> set[str]:
    """Files under version control, as the checkout has them."""
    listed = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    return {name for name in listed.splitlines() if (ROOT / name).is_file()}


def complaints(dist: Path) -> list[str]:
    """What is wrong with the one sdist and the one wheel in a folder."""
    (wheel,), (sdist,) = dist.glob("*.whl"), dist.glob("*.tar.gz")
    files = tracked()
    ours = {name for name in files if name.split("/")[0] in PACKAGES}
    shipped = {f"pianorig/{name}" for name in files if name.startswith(SHIPPED)}
    with zipfile.ZipFile(wheel) as archive:
        inside = {name for name in archive.namelist() if not name.split("/")[0].endswith(".dist-info")}
    with tarfile.open(sdist) as archive:
        packed = {name.partition("/")[2] for name in archive.getnames()}
    said = [f"wheel lacks {name}" for name in sorted((ours | shipped) - inside)]
    said += [f"wheel has {name}, which is not in the checkout" for name in sorted(inside - ours - shipped)]
    said += [f"wheel has {name}, which is not for users" for name in sorted(inside) if NOT_FOR_USERS.search(name)]
    said += [f"wheel lacks {package}/py.typed" for package in PACKAGES if f"{package}/py.typed" not in inside]
    said += [f"sdist lacks {name}" for name in sorted({*ours, *IN_SDIST} - packed)]
    said += [f"sdist has {name}, which is not in the checkout" for name in sorted(packed - files - {"PKG-INFO"})
             if name and not any(other.startswith(f"{name}/") for other in packed)]  # fmt: skip
    return said


if __name__ == "__main__":
    found = complaints(Path(sys.argv[1]))
    print("\n".join(found) or "sdist and wheel hold what they should")
    raise SystemExit(bool(found))
