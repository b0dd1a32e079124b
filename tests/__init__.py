"""Tests of all packages.

One thread for each process's matrix products, set before NumPy comes in: threads of two test processes wait for each
other, and small products take twenty times as long.
"""

import os

for _variable in ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")
