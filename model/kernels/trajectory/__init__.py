"""Kernels that loop over a scene's tables along a motion: what a run gives out beyond angles and speeds.

In: states (m, n), parameter vector and tables of any scene; out: contact and probe forces, penetrations, what holds a
prescribed key, a blow with set-valued friction. One compilation serves all scenes.
"""
