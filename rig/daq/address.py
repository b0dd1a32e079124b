"""Opening ``ni://local`` (NI-DAQmx driver of this computer) and ``ni-grpc://host[:port]`` (NI gRPC Device Server)."""

from __future__ import annotations

import contextlib
from pathlib import Path
from urllib.parse import parse_qsl, urlsplit

import grpc
import nidaqmx.errors

from rig.configuration.rig_file import RigConfig
from rig.daq.discovery import FoundDevice, driver_version, find_devices
from rig.daq.faults import translate_faults
from rig.daq.nidaqmx_backend import NidaqmxBackend
from rig.daq.server_claim import ServerClaim
from rig.errors import RigInputError

DEFAULT_PORT = 31763
RESET = "/nidevice_grpc.SessionUtilities/ResetServer"
RESET_TIMEOUT_S = 10.0  # of a server: it closes the tasks of all its clients first


def open_backend(url: str, config: RigConfig) -> NidaqmxBackend:
    """Connect to NI-DAQmx at ``ni://local`` or ``ni-grpc://host[:port]`` and check that its devices are those of
    ``config``; nothing is reset or reserved. Refuse another address or product. The caller closes it.

    A server with TLS: ``ni-grpc://host:port?ca=CA.pem``, with ``&cert=CLIENT.pem&key=CLIENT.key`` where it demands a
    certificate of its clients.
    """
    parts = urlsplit(url)
    if parts.scheme == "ni" and parts.netloc in ("", "local"):
        return _identify_devices(NidaqmxBackend(None, name="NI-DAQmx driver"), config)
    channel, target = _server(url)
    claim = ServerClaim(channel, target)
    return _identify_devices(NidaqmxBackend(channel, name=f"NI gRPC Device Server at {target}", claim=claim), config)


def discover(url: str) -> tuple[str, list[FoundDevice]]:
    """Return the driver's version and the devices behind ``ni://local`` or ``ni-grpc://host[:port]``."""
    parts = urlsplit(url)
    if parts.scheme == "ni" and parts.netloc in ("", "local"):
        return driver_version(None), find_devices(None)
    with _server(url)[0] as channel:
        return driver_version(channel), find_devices(channel)


def reset_server(url: str) -> str:
    """End all sessions of the NI gRPC Device Server at ``ni-grpc://host[:port]``, those of other programs too; return
    its host and port. Raise where it does not answer.

    Parameters
    ----------
    url : str

    Returns
    -------
    str
        Host and port of the server.

    Raises
    ------
    RigInputError
        For another address.
    HardwareFault
        When the server does not answer.

    Examples
    --------
    >>> import rig
    >>> try:
    ...     rig.reset_server("sim://")
    ... except rig.RigInputError as problem:
    ...     print("refused")
    refused
    """
    channel, target = _server(url)
    call = channel.unary_unary(RESET, request_serializer=lambda request: request, response_deserializer=lambda raw: raw)
    with channel, translate_faults("connect", f"server {target}"):
        try:
            call(b"", timeout=RESET_TIMEOUT_S)
        except grpc.RpcError as error:
            code = error.code() if isinstance(error, grpc.Call) else grpc.StatusCode.UNAVAILABLE
            raise nidaqmx.errors.RpcError(code, str(error)) from error
    return target


def _server(url: str) -> tuple[grpc.Channel, str]:
    """Return a channel to the server of an ``ni-grpc://host[:port]`` address, with TLS where it names files
    (``?ca=…``), and its host and port; refuse another address. Nothing is sent yet."""
    parts = urlsplit(url)
    try:
        port = parts.port or DEFAULT_PORT
    except ValueError as error:
        raise RigInputError(f"backend address {url!r}: {error}") from None
    if parts.scheme != "ni-grpc" or not parts.hostname:
        raise RigInputError(f"backend address {url!r}: allowed are ni://local and ni-grpc://host:{DEFAULT_PORT}")
    target = f"[{parts.hostname}]:{port}" if ":" in parts.hostname else f"{parts.hostname}:{port}"
    options = [("grpc.max_receive_message_length", -1)]
    files = dict(parse_qsl(parts.query, keep_blank_values=True))
    if not files:
        return grpc.insecure_channel(target, options=options), target
    if set(files) not in ({"ca"}, {"ca", "cert", "key"}):
        raise RigInputError(f"backend address {url!r}: allowed are ca=FILE, and cert=FILE and key=FILE with it")
    try:
        read = {name: Path(path).read_bytes() for name, path in files.items()}
    except OSError as error:
        raise RigInputError(f"backend address {url!r}: {error}") from None
    credentials = grpc.ssl_channel_credentials(read["ca"], read.get("key"), read.get("cert"))
    return grpc.secure_channel(target, credentials, options=options), target


def _identify_devices(backend: NidaqmxBackend, config: RigConfig) -> NidaqmxBackend:
    with contextlib.ExitStack() as unless_known:
        unless_known.callback(backend.close)
        backend.identify(config)
        unless_known.pop_all()
    return backend
