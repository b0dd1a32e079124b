"""The step loop of Rosenbrock methods for many members of a batch, several side by side in lanes.

In: members of one structure as rows of numbers (`model.kernels.signatures.LaneMembers`); out: the same rows, filled.
``rosenbrock`` is the loop, ``lane_input`` reads input tables, ``outputs`` gives the state inside a step,
``seats`` puts a member into a lane and takes it out.
"""
