"""Code generation: the compiled kernels of a scene, for single runs and lanes, from its elements (`model.elements`).

`load` finds them compiled, or compiles them; nobody writes a force twice.
"""
