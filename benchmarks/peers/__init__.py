"""What the work-precision benchmark compares with: force tables, equations, solvers, reference, table and diagram."""
