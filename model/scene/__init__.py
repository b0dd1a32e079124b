"""Scenes: which bodies, contacts, springs, drives and effects take part in a run.

An action and a `selection` come in; `build` returns the integer tables and the parameter vector that kernels read, from
`contacts`, `effect_terms` and, where the key is prescribed, a `key_motion`.
"""
