"""Work that joins several packages, one function per job; its names are imported when they are first used.

In: paths and options; out: sessions, films, tables, reports on disk, and records of what was found.
The groups ``bench``, ``film`` and ``model`` follow those of the commands; ``demo`` runs the main job from end to end.
"""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
