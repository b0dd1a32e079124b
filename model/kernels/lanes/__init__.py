"""Several members of a batch side by side in the lanes of one vector register, and what their kernels are made of.

In: the step loop for lanes (`model.integrators.lanes`); out: types, operators and functions in which a number is one
value per lane. Nothing here depends on the processor: all is
made of operations that IEEE 754 rounds correctly, so a lane's bits do not depend on its neighbours, width or machine.
"""
