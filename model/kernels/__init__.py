"""Compiled kernels of the model, private to it.

Tables and loops over bodies, springs, contacts and drives; no parameter value is compiled in.
``layout`` owns the order of numbers in the parameter vector, ``dynamics`` the accelerations,
``jacobian`` their derivatives, ``stepper`` the integration; ``compile`` the disk cache.
"""
