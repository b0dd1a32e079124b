"""The published data set of virtual strokes: its files, what describes them, how it is loaded and predictions scored.

In: a folder that ``pianorig dataset make`` wrote, or one that was published. Out: tables or xarray data sets of trials,
scores of predictions. Names are imported when first used.
"""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
