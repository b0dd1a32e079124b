"""Compiled kernels of the model, private to it; no parameter value is compiled in."""
