"""Forward sensitivities (tangents) of a motion: its derivatives by parameters, integrated along it.

In: named tuples of a run (`model.kernels.signatures`) and parameters as changes of its numbers; out: derivatives of
angles and speeds. `recorded_motion` integrates and keeps the motion, `nodes` linearises along it, `radau` is one step,
`follow` the loop. Why: docs/explanation/sensitivities.md.
"""
