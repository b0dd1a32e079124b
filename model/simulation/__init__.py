"""Runs of a scene: options, a run that can be stopped and resumed, its result, and static rest states.

In: a scene and an input table; out: states, forces and counters (`Solution`), or a rest state.
"""
