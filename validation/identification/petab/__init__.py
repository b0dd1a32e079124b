"""Tables in the manner of PEtab 1: parameters, observables, conditions, measurements, for others to fit these data.

In: an identification, or a folder of such tables. Out: the tables (`write`), or trials and parameters (`read`). PEtab's
model is SBML; ours is an action driven by a force table, so that the force of each condition is a table of its own.
"""
