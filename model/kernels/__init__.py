"""Compiled kernels of the model, private to it; no parameter value is compiled in.

In: a scene's integer tables and its parameter vector, in the order that ``layout`` gives; out: compiled functions.
``stepping`` plans steps; a scene's own kernels, and laws by themselves, are in `model.derived`.
"""
