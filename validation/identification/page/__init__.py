"""The reading of an identification: one page without outside addresses, plain sentences first.

In: `outcome.result.Identification`, and what was ranked to be recorded next. Out: HTML (`render`), whose figures are
`figures`, whose tables are `tables` and whose first lines are `sentences`.
"""
