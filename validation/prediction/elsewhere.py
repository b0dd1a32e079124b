"""Computations on threads of this process or on the workers of an executor; what is lost there is said.

Answers come in the order of the jobs, so that whatever is made of them is the same wherever they were computed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from typing import TypeVar

from model.errors import ModelError
from validation.conventions import WORKERS
from validation.errors import ValidationInputError

Job = TypeVar("Job")
Found = TypeVar("Found")


def lost(error: Exception) -> ValidationInputError:
    """What is said of a computation that did not come back."""
    what = " ".join(f"{type(error).__name__}: {error}".split())
    return ValidationInputError(
        f"identify: a run was lost where it was computed ({what}); nothing was written; run again"
    )


def spread(executor: Executor | None, one: Callable[[Job], Found], jobs: Sequence[Job]) -> list[Found]:
    """``one`` of every job, in their order, on the executor's workers or threads of this process.

    Raises
    ------
    model.errors.ModelError
        What ``one`` raises.
    ValidationInputError
        A worker was lost, and with it the job.
    """
    if executor is None:
        with ThreadPoolExecutor(WORKERS) as pool:
            return list(pool.map(one, jobs))
    try:
        return list(executor.map(one, jobs))
    except ModelError:
        raise
    except Exception as error:
        raise lost(error) from error
