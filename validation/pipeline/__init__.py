"""From sessions and models to results and a report: the public functions `compare`, `compare_many` and `validate_…`.

In: sessions, actions and options, as the user names them.
Out: `result.ValidationResult`, `side_by_side.SideBySide`, a report on disk; each stage is one call.
"""
