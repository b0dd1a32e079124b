"""Configuration of the documentation site; build it with ``python -m sphinx -W -b html docs docs/_build/html``.

The reference pages of Python names, commands and parameters are written at every build by ``make_reference_pages.py``,
so that they cannot lag behind the code.
"""

from __future__ import annotations

import sys
import tomllib
from pathlib import Path

DOCS = Path(__file__).parent
sys.path[:0] = [str(DOCS), str(DOCS.parent)]

import make_reference_pages  # noqa: E402

project = "piano-action-rig"
author = "the piano-action-rig developers"
copyright = f"2026, {author}"
project_table = tomllib.loads((DOCS.parent / "pyproject.toml").read_text(encoding="utf-8"))["project"]
release = version = project_table["version"]

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.autosummary", "numpydoc", "site_extensions"]
exclude_patterns = ["_build"]
html_theme = "furo"
html_title = f"piano-action-rig {release}"
html_math_renderer = "mathml"
html_show_sourcelink = False
html_copy_source = False

myst_enable_extensions = ["dollarmath", "deflist", "colon_fence"]
myst_heading_anchors = 3

autodoc_preserve_defaults = True
autodoc_member_order = "bysource"
autosummary_generate = False
numpydoc_show_class_members = False
default_role = "code"
smartquotes = False  # of two hyphens it would make a dash, also in options

make_reference_pages.write(DOCS / "reference" / "generated")
