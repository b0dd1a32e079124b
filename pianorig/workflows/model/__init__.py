"""What several commands do with the model: the force of a table or a trial, a cluster, a blow predicted or animated.

In: an action, tables of force, a session or a bench; out: arrays, callables, files. The mechanics is ``model``'s.
"""
