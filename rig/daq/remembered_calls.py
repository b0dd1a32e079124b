"""A ``grpc.Channel`` that makes each of its calls once: NI's client asks for all 451 of them anew with every task.

Over a socket that takes 15 ms of processor time, several times a trial.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import grpc


class RememberedCalls(grpc.Channel):
    """Another channel, whose callables are made when they are first asked for, and kept.

    Parameters
    ----------
    channel : grpc.Channel
        The connection; closing this closes it.
    """

    def __init__(self, channel: grpc.Channel) -> None:
        self._channel = channel
        self._made: dict[tuple[str, str], Callable[..., Any]] = {}

    def _once(self, kind: str, method: str, *args: Any, **kwargs: Any) -> Callable[..., Any]:
        if (kind, method) not in self._made:
            self._made[kind, method] = getattr(self._channel, kind)(method, *args, **kwargs)
        return self._made[kind, method]

    def unary_unary(self, method: str, *args: Any, **kwargs: Any) -> Any:
        """Return the callable of a call with one request and one response."""
        return self._once("unary_unary", method, *args, **kwargs)

    def unary_stream(self, method: str, *args: Any, **kwargs: Any) -> Any:
        """Return the callable of a call with one request and a stream of responses."""
        return self._once("unary_stream", method, *args, **kwargs)

    def stream_unary(self, method: str, *args: Any, **kwargs: Any) -> Any:
        """Return the callable of a call with a stream of requests and one response."""
        return self._once("stream_unary", method, *args, **kwargs)

    def stream_stream(self, method: str, *args: Any, **kwargs: Any) -> Any:
        """Return the callable of a call with a stream of requests and one of responses."""
        return self._once("stream_stream", method, *args, **kwargs)

    def subscribe(self, callback: Callable[..., Any], try_to_connect: bool | None = False) -> None:
        """Let a function be told of changes of the connection."""
        self._channel.subscribe(callback, try_to_connect)

    def unsubscribe(self, callback: Callable[..., Any]) -> None:
        """Tell it no longer."""
        self._channel.unsubscribe(callback)

    def close(self) -> None:
        """Close the connection."""
        self._channel.close()

    def __enter__(self) -> RememberedCalls:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()
