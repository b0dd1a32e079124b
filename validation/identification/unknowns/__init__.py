"""What may move in an identification: names and groups of parameters, and what is known of each beforehand.

In: an action, names as typed. Out: `priors.Unknowns`: parameters asked for, fitted beside, held.
"""
