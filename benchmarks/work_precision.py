"""Work against precision: our integrators and their peers on the same equations and the same force tables.

For every force table and every method the benchmark prints the largest angle error (max |Δθ| over the five angles, rad)
with the run time, right-hand sides, steps and rejections, and draws error against time into ``docs/work_precision.svg``.
(Skeleton; the measuring parts land in this file and in ``benchmarks/peers``.)
"""
