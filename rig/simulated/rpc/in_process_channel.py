"""A ``grpc.Channel`` that dispatches in process: the real client on the virtual device without a socket.

There are unary calls and event streams; calls the device does not have are answered with UNIMPLEMENTED.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from typing import Any

import grpc

from rig.simulated.rpc.event_streams import EventStream
from rig.simulated.rpc.messages import REFUSALS, Metadatum, rpc_status
from rig.simulated.rpc.service import Service


class InProcessError(grpc.RpcError):
    """What a failed call raises: status, text and trailing metadata, as over a socket."""

    def __init__(self, code: grpc.StatusCode, details: str, metadata: tuple[Metadatum, ...] = ()) -> None:
        super().__init__(details)
        self._code, self._details, self._metadata = code, details, metadata

    def code(self) -> grpc.StatusCode:
        """Return the gRPC status."""
        return self._code

    def details(self) -> str:
        """Return the text."""
        return self._details

    def trailing_metadata(self) -> tuple[Metadatum, ...]:
        """Return the trailing metadata."""
        return self._metadata


@contextlib.contextmanager
def _as_rpc_errors() -> Iterator[None]:
    try:
        yield
    except REFUSALS as error:
        raise InProcessError(*rpc_status(error)) from None


class InProcessStream:
    """The stream of a registered event, as a client iterates it."""

    def __init__(self, events: EventStream) -> None:
        self._events = events

    def initial_metadata(self) -> tuple[Metadatum, ...]:
        """Return the metadata that says that the event is registered."""
        return ()

    def done(self) -> bool:
        """Whether the stream failed while it was registered; it would have raised."""
        return False

    def cancel(self) -> bool:
        """End the stream."""
        self._events.cancel()
        return True

    def __iter__(self) -> Iterator[Any]:
        with _as_rpc_errors():
            yield from self._events


class InProcessChannel(grpc.Channel):
    """Channel to a :class:`rig.simulated.rpc.service.Service` in the same process."""

    def __init__(self, service: Service) -> None:
        self.service = service
        self._calls: dict[str, Callable[..., Any]] = {}

    def unary_unary(self, method: str, *args: Any, **kwargs: Any) -> Callable[..., Any]:
        """Return a callable for one call of the service; the client requests all of them for each of its tasks."""
        if method not in self._calls:
            self._calls[method] = self._unary_call(method)
        return self._calls[method]

    def _unary_call(self, method: str) -> Callable[..., Any]:
        name = method.rsplit("/", 1)[-1]

        def call(request: Any, timeout: float | None = None, metadata: Any = None, **options: Any) -> Any:
            with _as_rpc_errors():
                return self.service.handle(name, request)

        return call

    def unary_stream(self, method: str, *args: Any, **kwargs: Any) -> Callable[..., Any]:
        """Return a callable that registers an event and returns its stream."""
        name = method.rsplit("/", 1)[-1]

        def call(request: Any, timeout: float | None = None, metadata: Any = None, **options: Any) -> InProcessStream:
            with _as_rpc_errors():
                return InProcessStream(self.service.stream(name, request))

        return call

    def stream_stream(self, method: str, *args: Any, **kwargs: Any) -> Callable[..., Any]:
        """Return a callable that refuses: NI's service has no streams of requests."""

        def call(*args: Any, **kwargs: Any) -> Any:
            raise InProcessError(grpc.StatusCode.UNIMPLEMENTED, f"not simulated: {method}")

        return call

    stream_unary = stream_stream

    def subscribe(self, callback: Callable[..., Any], try_to_connect: bool | None = False) -> None:
        """Do nothing: this channel is always connected."""

    def unsubscribe(self, callback: Callable[..., Any]) -> None:
        """Do nothing."""

    def close(self) -> None:
        """Do nothing; the device lives on, so that its state can be inspected."""

    def __enter__(self) -> InProcessChannel:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()
