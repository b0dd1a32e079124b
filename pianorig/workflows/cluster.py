"""A Dask cluster as an executor, by the address of its scheduler."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from typing import Any

from pianorig.errors import CommandInputError

TIMEOUT_S = 10
LOGGERS = ("distributed.client", "distributed.core", "distributed.utils")


@contextmanager
def cluster_executor(address: str) -> Iterator[Executor]:
    """Connect to the scheduler at ``address`` and yield an executor of its workers.

    Raises
    ------
    CommandInputError : Dask is not installed, nothing answers there, or the cluster has no workers
    """
    try:
        import distributed  # start-up: 0.5 s, an extra
    except ImportError:
        raise CommandInputError('--cluster: needs dask; python -m pip install "piano-action-rig[cluster]"') from None
    try:
        client: Any = distributed.Client(address, timeout=TIMEOUT_S)
    except (OSError, TimeoutError, ValueError) as problem:
        why = " ".join(str(problem).split()) or type(problem).__name__
        raise CommandInputError(
            f"--cluster {address}: no scheduler answers ({why}); start one with dask scheduler, allowed tcp://host:port"
        ) from None
    with _quiet():
        try:
            if not client.scheduler_info()["workers"]:
                raise CommandInputError(f"--cluster {address}: has no workers; start some with dask worker {address}")
            yield client.get_executor()
        finally:
            client.close()


@contextmanager
def _quiet() -> Iterator[None]:
    """Keep Dask from printing the traceback of a lost scheduler: the command says that in one line."""
    loggers = [logging.getLogger(name) for name in LOGGERS]
    levels = [one.level for one in loggers]
    for one in loggers:
        one.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        for one, level in zip(loggers, levels, strict=True):
            one.setLevel(level)
