"""Symbolic expression graphs, programs of them, and their lowering to machine code."""
