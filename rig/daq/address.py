"""Opening ``ni://local`` (NI-DAQmx driver of this computer) and ``ni-grpc://host[:port]`` (NI gRPC Device Server)."""

from __future__ import annotations

import contextlib
from urllib.parse import urlsplit

import grpc

from rig.configuration.rig_file import RigConfig
from rig.daq.nidaqmx_backend import NidaqmxBackend
from rig.errors import RigInputError

DEFAULT_PORT = 31763


def open_backend(url: str, config: RigConfig) -> NidaqmxBackend:
    """Open ``ni://local`` or ``ni-grpc://host[:port]``; raises RigInputError for another address."""
    parts = urlsplit(url)
    try:
        port = parts.port or DEFAULT_PORT
    except ValueError as error:
        raise RigInputError(f"backend address {url!r}: {error}") from None
    if parts.scheme == "ni" and parts.netloc in ("", "local"):
        return _identified(NidaqmxBackend(None, name="NI-DAQmx driver"), config)
    if parts.scheme == "ni-grpc" and parts.hostname:
        target = f"{parts.hostname}:{port}"
        channel = grpc.insecure_channel(target, options=[("grpc.max_receive_message_length", -1)])
        return _identified(NidaqmxBackend(channel, name=f"NI gRPC Device Server at {target}"), config)
    raise RigInputError(f"backend address {url!r}: allowed are ni://local and ni-grpc://host:{DEFAULT_PORT}")


def _identified(backend: NidaqmxBackend, config: RigConfig) -> NidaqmxBackend:
    with contextlib.ExitStack() as unless_known:
        unless_known.callback(backend.close)
        backend.identify(config)
        unless_known.pop_all()
    return backend
