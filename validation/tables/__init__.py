"""Every table of a comparison, one module a table: its columns, its rows, and where it stands on the page.

A module ``NAME.py`` with a `TABLE` is a table; nothing else names it. CSV, ``results.json``, its schema, the pages of
the documentation and the report read the columns. ``table``, ``comparison``, ``numbers``, ``catalogue`` and ``schema``
serve all of them."""
