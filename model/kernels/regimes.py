"""Types of what `model.derived.slopes` gives, and the bits by which it tells the regimes of contacts."""

from numba import types

from model.kernels.kernel_value import pointer

# bits of contacts that push; beside an arc; that slide forwards; of felt with memory that is pressed in
BESIDE, SLIDING, PRESSED = 15, 30, 45
MOST_CONTACTS = 15  # that such bits have room for

REGIME = types.int64(pointer, pointer)  # w, p -> bits
SLOPES = types.int64(pointer, pointer, pointer, pointer)  # w, input, p, rows to fill -> 0
