"""Commands of the model: simulation, touch, studies, regulation, calibration of an action's parts.

In: actions by name or file, tables of force, motion or loading; out: column files, figures, action files, tables.
The mechanics is ``model``'s; what several commands need is in ``pianorig.workflows.model``.
"""
