"""The linear model of each trial where its own scatter took it."""

from __future__ import annotations
