"""Print constraints for pip that pin every run-time dependency to the lowest version that pyproject.toml allows."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

DEPENDENCY = re.compile(r"([A-Za-z0-9_.-]+)(?:\[.*\])?>=([0-9.]+)")


def lowest() -> list[str]:
    """One ``name==version`` for each dependency; a dependency without a lower bound is an error."""
    project = tomllib.loads((Path(__file__).parents[1] / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    pins = []
    for text in project["dependencies"]:
        found = DEPENDENCY.match(text)
        if found is None:
            raise SystemExit(f"pyproject.toml: dependency {text!r} has no lower bound; add >=VERSION")
        pins.append(f"{found[1]}=={found[2]}")
    return pins


if __name__ == "__main__":
    print("\n".join(lowest()))
