"""Does every plausible action run, and does every absurd one end in a right answer or a typed refusal?

    python benchmarks/stability.py [--count 10000] [--seed 1] [--set A|B] [--replay FILE]

Set A (plausible): geometry +-2 mm, everything else +-50 %, v_t 1e-2..1e-5, forces to 120 N with 0.2 ms edges.
Set B (abuse): geometry +-50 %, no damping, no friction, deep penetration at start, v_t to 1e-6, NaN and infinite
force. A case is plain data made from (set, seed, number); a failed case is written as a file that ``--replay``
runs again. Skeleton: the cases follow.
"""

from __future__ import annotations
