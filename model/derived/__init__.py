"""What jobs ask of a scene, derived from its elements (`model.elements`): kernels of a step, in lanes or not, energies.

`load` finds them compiled, or compiles them; nobody writes a force twice.
"""
