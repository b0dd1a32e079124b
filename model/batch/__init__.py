"""Many simulations at once: trials times parameter sets, on threads, processes or a cluster, resumable.

In: force tables and parameter values by name; out: a `Member` each, with its solution or its error. ``job`` describes
and computes one member, ``lanes`` computes many of a kind side by side, ``run`` hands jobs to an executor, ``store``
archives finished members in a folder.
"""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
