"""Which part of the model explains the difference a report shows: the sets of changes compatible with the trials.

In: the model under test and a few sound trials of one kind of stroke. Out: `explain.Explained`: every smallest set of
changes that explains them, with sizes and u, or why none does. `candidates` says what may be wrong, `responses` what
the model does then, `evidence` weighs it, `search` finds the sets.
"""
