"""Where measured meets predicted: signals, events, repeatability, scores, report.

In: sessions of `rig` and predictions of `model`. Out: `ValidationResult`, several of them `SideBySide`, and from these
``report.html`` and ``results.json``. Names are imported when first used, so that importing `validation` costs nothing;
they stand with their types in ``__init__.pyi``.
"""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
