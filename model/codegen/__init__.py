"""Code generation: the compiled kernels of a scene, for single runs and lanes, from its elements (`model.elements`)."""
