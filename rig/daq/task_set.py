"""Tasks that are made once and used for every trial: stopped and unreserved in between, cleared only at the end.

This follows the state model of NI-DAQmx (verified → committed → running and back). An unreserved task keeps its
settings and reserves no hardware: the watchdog of a chassis can start before the others, and other tasks can have the
channels. Errors are those of ``nidaqmx``, translated by the caller.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Protocol

import nidaqmx
from nidaqmx.constants import TaskMode


class NewTask(Protocol):
    """Makes an empty task with the given name on the driver or server in use."""

    def __call__(self, name: str) -> nidaqmx.Task:
        """Make the task."""
        ...


class TaskSet:
    """Open tasks by name in the order they were made; registered as soon as they exist, so that none is lost.

    Parameters
    ----------
    new_task : NewTask
    end_left : callable
        Ends what a server may still have of a task of ours that could not be cleared, by its name.
    """

    def __init__(self, new_task: NewTask, end_left: Callable[[str], None]) -> None:
        self._new_task, self._end_left = new_task, end_left
        self._tasks: dict[str, nidaqmx.Task] = {}
        self._left: set[str] = set()
        """Names of tasks whose clearing failed: a server may still have them, and refuses another of the name."""

    def __contains__(self, name: str) -> bool:
        return name in self._tasks

    def __getitem__(self, name: str) -> nidaqmx.Task:
        return self._tasks[name]

    def __iter__(self) -> Iterator[str]:
        return iter(tuple(self._tasks))

    def make(self, name: str) -> nidaqmx.Task:
        """Make an empty task and register it; one of that name that could not be cleared is cleared now."""
        if name in self._left:
            self._end_left(name)
            self._left.discard(name)
        self._tasks[name] = task = self._new_task(name)
        return task

    def unreserve(self, name: str) -> None:
        """Stop a task and unreserve its hardware, or clear it where that fails; nothing happens without the task."""
        if name not in self._tasks:
            return
        task = self._tasks[name]
        try:
            with _early_stop_expected():
                task.stop()
            task.control(TaskMode.TASK_UNRESERVE)
        except nidaqmx.errors.Error:
            self.clear(name)  # e.g. a generation that failed reports it when it is stopped

    def clear(self, name: str) -> None:
        """Clear a task; when the driver refuses it is tried again before another of the name is made."""
        task = self._tasks.pop(name, None)
        if task is not None:
            self._left.add(name)
            with _early_stop_expected():
                task.close()
            self._left.discard(name)


@contextmanager
def _early_stop_expected() -> Iterator[None]:
    """The driver warns (200010) when a finite generation is stopped before its end."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", nidaqmx.errors.DaqWarning)
        yield
