"""Step kernels of a scene, written as straight-line Python source from its structure alone, and loaded.

In: integer tables of a scene; out: compiled functions (`model.kernels.signatures.StepKernels`). ``load`` is the entry,
``step_kernels`` puts the module together from ``bodies``, ``contacts``, ``contact_kinds`` and ``energy``.
"""
