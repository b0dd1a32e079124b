"""How a refusal travels to a client: gRPC status, text and trailing metadata, as NI's server sends them."""

from __future__ import annotations

from typing import NamedTuple

import grpc

from rig.simulated.status import DaqStatusError, ServerGone, SessionRefused

REFUSALS = (DaqStatusError, SessionRefused, ServerGone)


class Metadatum(NamedTuple):
    """One entry of trailing metadata."""

    key: str
    value: str


def rpc_status(error: Exception) -> tuple[grpc.StatusCode, str, tuple[Metadatum, ...]]:
    """Return the gRPC status, text and trailing metadata by which a client sees one of :data:`REFUSALS`."""
    if isinstance(error, DaqStatusError):
        numbers = {
            "ni-error": error.code,
            "ni-samps-per-chan-read": error.samples_read,
            "ni-samps-per-chan-written": error.samples_written,
        }
        metadata = tuple(Metadatum(key, str(number)) for key, number in numbers.items() if number is not None)
        return grpc.StatusCode.UNKNOWN, str(error), metadata
    if isinstance(error, SessionRefused):
        return grpc.StatusCode[error.code], str(error), ()
    if isinstance(error, ServerGone):
        return grpc.StatusCode.UNAVAILABLE, f"failed to connect: {error}", ()
    raise error
