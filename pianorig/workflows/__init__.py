"""Work that joins several packages, one function per job; its names are imported when they are first used.

In: paths and options; out: sessions, films, tables, reports on disk, and records of what was found.
Here lies what several commands share, or command and page; what one command does stands in its own file.
"""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
