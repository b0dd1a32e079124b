"""What members of a batch hold, and executors that are far away, last first, or lose what they are given."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from dataclasses import fields
from typing import Any

import model
from model import batch
from model.batch.job import Job


def content(solution: model.Solution) -> list[Any]:
    """All of a solution as bytes and numbers, its action by what was changed."""
    values = {item.name: getattr(solution, item.name) for item in fields(model.Solution)}
    values["action"] = solution.action and (solution.action.name, dict(solution.action.changed))
    for name, parts in (("string", ("rows",)), ("give", ("way_m", "speed_m_per_s", "force_n"))):
        values |= {f"{name} {part}": getattr(values[name], part, None) for part in parts}
        del values[name]
    return [v.tobytes() if hasattr(v, "tobytes") else v for v in values.values()]


def contents(members: list[batch.Member]) -> list[list[Any]]:
    """Of each member all of its solution, or the text of its error."""
    return [[type(m.error).__name__, str(m.error)] if m.solution is None else content(m.solution) for m in members]


class Elsewhere(Executor):
    """Another process in miniature: work is pickled, arrays come back read-only; the last unit is done first, once it
    holds as many as will come."""

    def __init__(self, after: int) -> None:
        self.held: list[tuple[Future[Any], Callable[..., Any], tuple[Any, ...]]] = []
        self.after = after

    def submit(self, fn: Any, /, *args: Any, **kwargs: Any) -> Any:
        future: Future[Any] = Future()
        self.held.append((future, fn, args))
        if len(self.held) == self.after:
            for waiting, function, values in reversed(self.held):
                jobs, hashes = pickle.loads(pickle.dumps(values))
                for job in jobs:
                    job.run.scene.vector.setflags(write=False)
                    job.run.force_n.setflags(write=False)
                waiting.set_result(pickle.loads(pickle.dumps(function(jobs, hashes))))
        return future


class Loses(ThreadPoolExecutor):
    """Its worker is lost with every unit that begins with such a job."""

    def __init__(self, lost: Callable[[Job], bool]) -> None:
        super().__init__(1)
        self.lost = lost

    def submit(self, fn: Any, /, *args: Any, **kwargs: Any) -> Any:
        if not self.lost(args[0][0]):
            return super().submit(fn, *args, **kwargs)
        future: Future[Any] = Future()
        future.set_exception(MemoryError("worker lost"))
        return future
