"""Layout of what `model.derived.slopes` gives: bits of contacts, rows of their normal forces' derivatives."""

from numba import types

from model.kernels.kernel_value import pointer
from model.kernels.layout import K_A

BESIDE, SLIDING = 20, 40  # bits of contacts beside an arc, and of those that slide forwards
MOST_CONTACTS = 20  # that such bits have room for
OWN = K_A + 4  # numbers of a contact that its normal force depends on: surfaces, felt

REGIME = types.int64(pointer, pointer)  # w, p -> bits
SLOPES = types.int64(pointer, pointer, pointer, pointer)  # w, input, p, rows to fill -> 0


def normal_size(n: int) -> int:
    """Numbers of a contact's row: force, derivatives by n coordinates, n speeds, own numbers, pivots' x and y."""
    return 1 + 4 * n + OWN
