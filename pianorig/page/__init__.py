"""The bench in a browser: one local page, served from this computer to this computer, that works without internet.

In: a folder of sessions. Out: pages, tables and curves over HTTP on the loopback; notes and reports on disk, with
``--control``. Drawing in the browser is done by Bokeh's own JavaScript, from its package; needs the extra ``bench``.
"""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
