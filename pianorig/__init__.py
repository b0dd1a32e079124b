"""The command line ``pianorig``: composes model, rig, vision and validation; holds no science of its own."""

from __future__ import annotations

import os

for _library in ("OPENBLAS", "MKL"):
    # matrices here have some hundred rows: more threads wait for each other and use up the budget of `identify`
    os.environ.setdefault(f"{_library}_NUM_THREADS", "1")


def __getattr__(name: str) -> str:
    """The installed version, read from the distribution's metadata on first use."""
    if name != "__version__":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import metadata  # start-up: reading metadata costs 10 ms, no command needs it

    return metadata.version("piano-action-rig")
