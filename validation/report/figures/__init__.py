"""Figures of the page, drawn like those of the thesis.

In: traces of the results of one session, `view.SessionView`.
Out: `layout.ReportFigure`, self-contained SVG text with caption and description.
"""
