"""Small addition to Sphinx: formulas as MathML.

MathML is drawn by browsers themselves: no script from a network, so that the built site works offline.
"""

from __future__ import annotations

import re
from typing import Any

from docutils import nodes
from latex2mathml.converter import convert
from sphinx.application import Sphinx

TAG = re.compile(r"\\tag\{(.+?)\}")
ROW = "display: flex; justify-content: space-between; margin: 1em 0"


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the addition."""
    app.add_html_math_renderer("mathml", (_inline, None), (_block, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _inline(translator: Any, node: nodes.math) -> None:
    translator.body.append(convert(node.astext()))
    raise nodes.SkipNode


def _block(translator: Any, node: nodes.math_block) -> None:
    formula = convert(TAG.sub("", node.astext()).strip(), display="block")
    number = "".join(f"({tag})" for tag in TAG.findall(node.astext()))
    translator.body.append(f'<div style="{ROW}"><span></span><span>{formula}</span><span>{number}</span></div>')
    raise nodes.SkipNode
