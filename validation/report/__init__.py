"""The report: ``report.html``, ``results.json`` and a CSV per table, written whole or not at all.

In: `side_by_side.SideBySide`, of one session and model or of several; nothing is computed here.
Out: one page complete in itself, the results for programs, a table of each kind; degrees and millimetres on the page.
"""
