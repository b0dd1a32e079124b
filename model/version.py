"""Version of the installed distribution, read from its metadata."""

from importlib.metadata import version

__version__ = version("piano-action-rig")
