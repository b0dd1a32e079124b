"""Tables of the page: numbers as text, with as many digits as their uncertainty justifies.

In: data frames of `result.ValidationResult`, in SI units and radians.
Out: `formatting.PageTable` in degrees, millimetres and milliseconds; a dash for what does not exist.
"""
