"""Write `docs/reference/licences.md`: dependencies of the project with the licence each declares.

Run after changing dependencies, in an environment that has them:  python docs/make_licences_page.py
Direct dependencies come from `pyproject.toml`, licences from the installed packages' own metadata; nothing is looked
up elsewhere. A package that is not installed is listed as such.
"""

from __future__ import annotations

import re
import tomllib
from importlib.metadata import PackageMetadata, PackageNotFoundError, metadata
from pathlib import Path

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "reference" / "licences.md"
NAME = re.compile(r"[A-Za-z0-9._-]+")
CLASSIFIER = "License :: OSI Approved :: "
LONGEST = 60
HEAD = """# Licences of dependencies

piano-action-rig itself is BSD-3-Clause. Direct dependencies, what needs them, and the licence that each declares in its
own metadata, made by `python docs/make_licences_page.py`. Nothing here is distributed with this project: pip installs
it. GPL packages are never imported at run time, with one exception: the wheel of PyAV (BSD) ships FFmpeg with GPL
codecs (x264, x265); it is used to decode, and nothing of it is redistributed.
"""


def dependencies() -> dict[str, list[str]]:
    """Map each direct dependency to what needs it: the program itself or extras."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    groups = {"run": project["dependencies"], **project["optional-dependencies"]}
    needed: dict[str, list[str]] = {}
    for group, lines in groups.items():
        for line in lines:
            found = NAME.match(line)
            if found is None:
                raise ValueError(f"pyproject.toml: dependency {line!r} of {group} has no name")
            needed.setdefault(found[0], []).append(group)
    return needed


def licence(about: PackageMetadata) -> str:
    """Return the licence a package declares, shortest statement first."""
    if expression := about.get("License-Expression"):
        return expression
    classified = [c.removeprefix(CLASSIFIER) for c in about.get_all("Classifier") or [] if c.startswith(CLASSIFIER)]
    if classified:
        return ", ".join(classified)
    text = " ".join((about.get("License") or "").split())
    return text if 0 < len(text) <= LONGEST else "see the package"


def page() -> str:
    """Return the page."""
    rows = []
    for name, groups in sorted(dependencies().items(), key=lambda item: item[0].lower()):
        try:
            stated = licence(metadata(name))
        except PackageNotFoundError:
            stated = "not installed where this page was made"
        rows.append(f"- {name} ({', '.join(groups)}): {stated}\n")
    return f"{HEAD}\n{''.join(rows)}"


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
