"""Rows of what a scene's observers find at states: one call of a kernel a row."""

from numba import types

from model.kernels.compile import kernel
from model.kernels.kernel_value import pointer

OBSERVE = types.int64(pointer, pointer, pointer, pointer)  # state, input, p, row to fill -> 0


@kernel
def rows_of(observe, x, u, p, y):
    """Fill rows ``y`` (m, k) from states ``x`` (m, n) and inputs ``u`` (m, l)."""
    for i in range(x.shape[0]):
        observe(x[i], u[i], p, y[i])
