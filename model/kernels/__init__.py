"""Compiled kernels of the model, private to it; no parameter value is compiled in.

In: a scene's integer tables and its parameter vector, in the order that ``layout`` gives; out: compiled functions.
What every scene shares; a scene's own kernels are made in `model.codegen`, from the elements in `model.elements`.
"""
