"""Which parameter values explain the measured strokes, how well they are known, and which cannot be known.

In: measured trials of one or more sessions, an action, names of parameters. Out: `outcome.result.Identification`:
values with intervals, what the strokes cannot separate, an action file. `unknowns` says what is free, `observations`
what is compared, `runs` what the model says, `blocks` and `noise` what differences mean; `fit` and `profiles`
follow; `residuals` is for optimisers of one's own.
"""
