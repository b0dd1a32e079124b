"""Peers of the work-precision benchmark: force tables, equations, solvers, reference, table and diagram."""
