"""Time integration of a scene by Rosenbrock methods: one step loop, one table of coefficients a method."""
