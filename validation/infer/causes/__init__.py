"""Which causes explain the differences a report shows: faults of the session and changes of the model in one search.

In: the model under test, sound trials of one kind of stroke, and what may be wrong (`validation.infer.hypotheses`).
Out: `explain.Explained`: causes or pairs of causes that explain the differences, with sizes and u, or why none does.
`responses` runs the model with a cause in some trials; `score_test` says whether there is one; `search` finds which;
`explain` decides what is named.
"""
