"""All tables, found in this folder: a module that has a `TABLE` is one."""

from __future__ import annotations

from functools import cache
from importlib import import_module
from pkgutil import iter_modules

from validation.tables.table import SECTIONS, Page, Table


def all_tables() -> dict[str, Table]:
    """Every table of comparisons by its name, in the order of the alphabet."""
    return {name: table for name, table in every_table().items() if table.of != "identification"}


@cache
def every_table() -> dict[str, Table]:
    """All tables, of comparisons and of identifications."""
    package = import_module("validation.tables")
    names = sorted(found.name for found in iter_modules(package.__path__))
    modules = (import_module(f"validation.tables.{name}") for name in names)
    tables = (getattr(module, "TABLE", None) for module in modules)
    return {table.name: table for table in tables if isinstance(table, Table)}


def pages_of(section: str) -> list[tuple[Table, Page]]:
    """What a section of a page shows, in its order."""
    assert section in SECTIONS, section
    found = [(table, page) for table in every_table().values() for page in table.pages if page.section == section]
    return sorted(found, key=lambda pair: pair[1].order)
