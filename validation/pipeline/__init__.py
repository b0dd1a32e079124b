"""From sessions and models to results and a report: the public functions `compare`, `compare_many` and `validate_…`."""
