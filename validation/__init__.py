"""Where measured meets predicted: signals, events, repeatability, scores, report."""

import lazy_loader as _lazy

_get, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)


def __getattr__(name: str) -> object:
    if name in ("correct_force", "find_quiet"):  # they are `rig`'s, and work here for one release
        import warnings  # start-up: a caller of today's names does not need it

        import rig  # start-up: as above

        warnings.warn(f"validation.{name} is rig.{name} now", DeprecationWarning, stacklevel=2)
        return getattr(rig, name)
    return _get(name)
