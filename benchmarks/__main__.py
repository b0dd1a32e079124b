"""Run a benchmark, list them all, or write the page of figures: `python -m benchmarks [NAME]`."""

import os
import sys

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as the command does, before NumPy is imported

from benchmarks.runner import main

if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
