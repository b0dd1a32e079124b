"""Which causes explain the differences a report shows: faults of the session and changes of the model in one search.

In: the model under test and sound trials of one kind of stroke. Out: `explain.Explained`: every smallest set of changes
that explains them, with sizes and u, or why none does. `responses` says what may be wrong, in which trials, and what
the model does then; `search` weighs it and finds the sets; `explain` decides what is named.
"""
