"""Touch of an action: touch weights, hammer speed against force, fastest repetition; several actions side by side."""

import lazy_loader as _lazy

from model.package_calls import refuse_call as _refuse_call

_get, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
_refuse_call(__name__, "model.measure_touch(action)")


def __getattr__(name: str) -> object:
    return _get({"feel": "measure_touch", "Feel": "Touch"}.get(name, name))  # their former names, for one release
