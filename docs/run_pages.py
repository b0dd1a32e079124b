"""Run the Python code of tutorials and how-to guides, and write what it prints into the pages.

Run after changing a page or what it shows:  python docs/run_pages.py [--check] [PAGE …]
The blocks of a page run in order in an empty folder, as one program. A block marked ``python no-run`` is skipped. A
``text`` block right after a code block is its output. With ``--check`` outputs are compared and not written, numbers
aside: they may differ from machine to machine in their last digits. A test does so with the tutorials, CI with all
pages.
"""

from __future__ import annotations

import contextlib
import io
import os
import re
import sys
import tempfile
from pathlib import Path
from typing import Any

DOCS = Path(__file__).parent
BLOCK = re.compile(
    r"^```python\n(?P<code>.*?)^```\n(?P<gap>\n```text\n(?P<output>.*?)^```\n)?", re.MULTILINE | re.DOTALL
)
NUMBER = re.compile(r"[-+]?\d+(\.\d+)?(e[-+]?\d+)?")


def pages() -> list[Path]:
    """Pages of tutorials and how-to guides that have code to run."""
    found = (page for folder in ("tutorials", "howto") for page in sorted((DOCS / folder).glob("*.md")))
    return [page for page in found if BLOCK.search(page.read_text(encoding="utf-8"))]


def run(page: Path) -> str:
    """Run a page's code in the present folder; return its text with the outputs of this run."""
    namespace: dict[str, Any] = {"__name__": page.stem}

    def replaced(block: re.Match[str]) -> str:
        printed = io.StringIO()
        with contextlib.redirect_stdout(printed):
            exec(compile(block["code"], page.name, "exec"), namespace)
        output = "\n".join(line.rstrip() for line in printed.getvalue().splitlines())
        shown = f"\n```text\n{output}\n```\n" if output else ""
        return f"```python\n{block['code']}```\n{shown}"

    return BLOCK.sub(replaced, page.read_text(encoding="utf-8"))


def outputs(text: str) -> list[str]:
    """What the blocks of a page print, with numbers and spaces made equal."""
    shown = (block["output"] or "" for block in BLOCK.finditer(text))
    return [" ".join(NUMBER.sub("#", output).split()) for output in shown]


def main() -> None:
    """Run the pages named on the command line, or all; write their outputs, or check them."""
    if {"-h", "--help"} & set(sys.argv):
        raise SystemExit(__doc__)
    home, names = Path.cwd(), [name for name in sys.argv[1:] if name != "--check"]
    for page in [Path(name).resolve() for name in names] or pages():
        with tempfile.TemporaryDirectory() as folder:
            os.chdir(folder)
            text = run(page)
            os.chdir(home)
        print(page.relative_to(DOCS))
        if "--check" not in sys.argv:
            page.write_text(text, encoding="utf-8")
        elif outputs(text) != outputs(page.read_text(encoding="utf-8")):
            raise SystemExit(f"{page}: prints something else than it shows")


if __name__ == "__main__":
    main()
