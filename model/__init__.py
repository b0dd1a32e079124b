"""The stiff multibody model of a grand-piano action: parameters, statics, simulation, measured quantities.

Parameter files and arrays in, arrays out. The model knows nothing of sessions or films and imports none of the other
packages. Public names stand in ``__init__.pyi``, which type checkers and editors read; each is imported on first use,
so that ``import model`` costs neither NumPy nor a compiler.

    action = model.load_action("hirschkorn2004-regulated")
    solution = model.simulate(action, time_s, force_n)
"""

import lazy_loader as _lazy

_get, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)


def __getattr__(name: str) -> object:
    return _get("scale_parameters" if name == "scaled" else name)  # its former name, for one release
