"""Docstrings of public functions: every part that a reader needs, and an example that runs as it stands."""

from __future__ import annotations

import functools
import inspect
import re

import pytest
from docutils import frontend
from docutils.parsers.rst import Parser
from docutils.transforms.references import Substitutions
from docutils.utils import Reporter, new_document

from tests.public_functions import public_classes, public_functions, with_methods

FUNCTIONS = public_functions()


def section(text: str, title: str) -> str | None:
    """The text below a heading of numpydoc's, None where there is none."""
    found = re.search(rf"^{title}\n-+\n(.*?)(?=^[A-Z][a-z ]+\n-+\n|\Z)", text, re.MULTILINE | re.DOTALL)
    return found[1] if found else None


@pytest.mark.parametrize("name", FUNCTIONS)
def test_a_public_function_says_what_it_takes_returns_and_refuses(name: str) -> None:
    function = FUNCTIONS[name]
    text = inspect.getdoc(function) or ""
    signature = inspect.signature(function)
    taken = section(text, "Parameters") or ""
    for parameter in signature.parameters.values():
        if parameter.kind is not parameter.VAR_KEYWORD:
            assert re.search(rf"^[\w, ]*\b{parameter.name}\b", taken, re.MULTILINE), (
                f"{parameter.name} is not described"
            )
    if signature.return_annotation not in ("None", None):
        assert section(text, "Returns"), "what it returns is not described"
    if re.search(r"^\s+raise [A-Z]", inspect.getsource(function), re.MULTILINE):
        assert section(text, "Raises"), "what it refuses is not described"
    assert ">>>" in (section(text, "Examples") or ""), "it has no example"


def test_every_public_class_its_methods_and_properties_have_a_docstring() -> None:
    """Elsewhere ruff asks for one only of modules: a name and a signature that say it all need no more."""
    members = {
        f"{name}.{key}": member
        for name, one in public_classes().items()
        for key, member in vars(one).items()
        if not key.startswith("_") and isinstance(member, property | functools.cached_property)
    }
    silent = [n for n, one in {**with_methods(), **public_classes(), **members}.items() if not inspect.getdoc(one)]
    assert not silent, silent


def test_markup_of_public_docstrings_is_closed_and_refers_to_nothing_unknown() -> None:
    """``|dx|`` outside of literals asks for a substitution, which stops the site; few build it.

    Sections are numpydoc's and set by it, so that only what stands within a line is judged.
    """
    settings = frontend.get_default_settings(Parser)
    settings.report_level, settings.halt_level, settings.warning_stream = Reporter.WARNING_LEVEL, 5, ""
    said: list[str] = []
    for name, one in {**with_methods(), **public_classes()}.items():
        document = new_document(name, settings)
        document.reporter.attach_observer(lambda message: said.append(message.astext()))
        text = re.sub(r"^\*+(?=\w)", "", inspect.getdoc(one) or "", flags=re.MULTILINE)  # of **keywords
        Parser().parse(text, document)
        Substitutions(document).apply()
    wrong = [one for one in said if re.search("without end-string|Undefined substitution|Unknown target", one)]
    assert not wrong, "\n".join(wrong)
