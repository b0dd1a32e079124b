"""Time integration of a scene by Rosenbrock methods: one step loop, one table of coefficients a method.

In: named tuples of a run (`model.kernels.signatures`); out: the state changed in place, rows of outputs, counters.
``methods`` finds a method by name, ``rosenbrock`` is the step loop, ``step_control`` how long a step is.
"""
