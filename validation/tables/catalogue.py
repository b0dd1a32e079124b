"""All tables, found in this folder: a module that has a `TABLE` is one."""

from __future__ import annotations

from functools import cache
from importlib import import_module
from pkgutil import iter_modules

from validation.tables.table import SECTIONS, Page, Table


@cache
def all_tables() -> dict[str, Table]:
    """Every table by its name, in the order of the alphabet."""
    package = import_module("validation.tables")
    names = sorted(found.name for found in iter_modules(package.__path__))
    modules = (import_module(f"validation.tables.{name}") for name in names)
    tables = (getattr(module, "TABLE", None) for module in modules)
    return {table.name: table for table in tables if isinstance(table, Table)}


def pages_of(section: str) -> list[tuple[Table, Page]]:
    """What a section of a page shows, in its order."""
    assert section in SECTIONS, section
    found = [(table, page) for table in all_tables().values() for page in table.pages if page.section == section]
    return sorted(found, key=lambda pair: pair[1].order)
