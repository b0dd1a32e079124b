"""The benchmarks as their files list them: claims, sizes, figures, and the commands that pages name."""

from __future__ import annotations

import json
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from tests.test_docs import PAGES

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "benchmarks"
ENTRIES = tomllib.loads((FOLDER / "registry.toml").read_text(encoding="utf-8"))
CODE = ENTRIES.pop("code")
CALL = re.compile(r"python -m benchmarks ([a-z]\w+)([^`\n]*)")
DATED, STALE = re.compile(r"\| \d{4}-\d\d-\d\d, "), re.compile(r"; \*\*stale\*\*: [^|]*? \|")
COMMON = {"quick", "results", "minutes", "write", "against"}
"""Options that every benchmark takes."""


def work_of(name: str) -> str:
    """Source of the file of a benchmark."""
    return (FOLDER / f"{ENTRIES[name].get('module', name)}.py").read_text(encoding="utf-8")


@pytest.mark.parametrize("name", ENTRIES)
def test_a_benchmark_has_a_claim_and_two_sizes_and_measures_what_exists(name: str) -> None:
    entry = ENTRIES[name]
    assert re.search(rf"^def {name if 'module' in entry else 'main'}\(\w+: Run\)", work_of(name), re.MULTILINE)
    assert entry["claim"] and not entry["claim"].endswith(".")
    measured = [path for one in entry["measures"] for path in CODE.get(one, [one])]
    assert measured and all((ROOT / path.removeprefix(":!")).exists() for path in measured)
    quick = {key: type(value) for key, value in entry.get("quick", {}).items()}
    assert quick == {key: type(entry["full"][key]) for key in quick}


def test_every_benchmark_is_registered() -> None:
    files = [path for path in FOLDER.glob("*.py") if path.stem not in ("runner", "__main__")]
    assert {path.stem for path in files if "\ndef main(" in path.read_text(encoding="utf-8")} == {
        name for name in ENTRIES if "module" not in ENTRIES[name]
    }


def test_help_shows_a_default_with_a_percent_sign() -> None:
    assert any("%" in value for value in ENTRIES["verdict_coverage"]["full"]["effects"])
    command = [sys.executable, "-m", "benchmarks", "verdict_coverage", "--help"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    assert "hammer scale 3 %" in " ".join(done.stdout.split())


def test_the_page_of_figures_has_what_the_results_say() -> None:
    rows = [json.loads(line) for line in (FOLDER / "results.jsonl").read_text(encoding="utf-8").splitlines()]
    page = (ROOT / "docs" / "figures.md").read_text(encoding="utf-8").splitlines()
    shown = [STALE.sub(" |", line) for line in page if DATED.search(line)]
    told = [f"| {r['quantity']} | {r['figure']} | {r['date']}, {r['commit']} | {r['command']} |" for r in rows]
    assert sorted(shown) == sorted(told), "run: python -m benchmarks figures"
    assert len({row["row"] for row in rows}) == len(rows)
    assert not [row["row"] for row in rows if row["benchmark"] not in ENTRIES and not row.get("measures")]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_benchmarks_and_options_named_in_a_page_exist(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    for name, rest in CALL.findall(text):
        if name == "figures":
            continue
        assert name in ENTRIES, f"{page.name}: python -m benchmarks {name}"
        own = COMMON | {key.replace("_", "-") for key in ENTRIES[name]["full"]}
        for option in re.findall(r"(?<!\S)\[?--([a-z][\w-]*)", rest.split("; ")[0].split(" -- ")[0]):
            assert option in own or option.removeprefix("no-") in own, f"{page.name}: {name}: --{option}"


def test_a_name_that_is_none_is_told() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "benchmarks", "nonsense"], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 2 and "benchmark: found nonsense" in done.stderr
    assert all(name in done.stdout for name in ENTRIES)


def test_mutations_are_of_lines_that_are_there_once() -> None:
    """But for a tenth: code changes, and a mutation whose line is gone is told and not counted."""
    mutations = tomllib.loads((FOLDER / "mutations.toml").read_text(encoding="utf-8"))["mutation"]
    gone = []
    for number, mutation in enumerate(mutations):
        path = ROOT / mutation["file"]
        lines = path.read_text(encoding="utf-8").splitlines() if path.is_file() else []
        gone += [number] * ([line.strip() for line in lines].count(mutation["line"]) != 1)
        assert mutation["line"] != mutation["becomes"]
    assert len(gone) <= len(mutations) // 10, gone
