"""``pianorig serve-sim``: the virtual bench as a network device for any client of the NI gRPC Device Server."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from pianorig.console.options import AsJson, Rig
from pianorig.console.output import print_json
from pianorig.errors import CommandInputError
from rig import simulated


def command(
    port: Annotated[int, typer.Option("--port", min=0, max=65535, help="TCP port; 0 takes a free one.")] = 31763,
    host: Annotated[
        str, typer.Option("--host", help="Address to listen on; one that is not local opens the bench to the network.")
    ] = "127.0.0.1",
    rig: Rig = "virtual",
    clock: Annotated[str, typer.Option("--clock", help="real, virtual (as fast as it is read), or a speed.")] = "real",
    seed: Annotated[int | None, typer.Option("--seed", min=0, help="Seed of all random scatter.")] = None,
    bench: Annotated[Path | None, typer.Option("--bench", help="Bench file; default: the built-in one.")] = None,
    fault: Annotated[
        str | None, typer.Option("--fault", help="Faults to plant, e.g. overwrite@1/0.5 (trial/seconds).")
    ] = None,
    hand: Annotated[
        bool, typer.Option("--hand", help="Let the virtual operator's hand act when a self-test asks for it.")
    ] = False,
    felt: Annotated[
        str | None, typer.Option("--felt", help="The arm is on the felt of this contact, or on a `block`, not the key.")
    ] = None,
    allow_network: Annotated[
        bool, typer.Option("--allow-network", help="Permit a --host that other computers can reach.")
    ] = False,
    tls: Annotated[
        tuple[Path, Path] | None, typer.Option("--tls", metavar="CERT KEY", help="PEM files: serve with TLS.")
    ] = None,
    client_ca: Annotated[
        Path | None, typer.Option("--tls-client-ca", help="PEM file: clients must show a certificate of this CA.")
    ] = None,
    log: Annotated[bool, typer.Option("--log", help="Print a JSON line when outputs become live or safe.")] = False,
    as_json: AsJson = False,
) -> None:
    """Serve the virtual DAQ device over TCP until Ctrl-C.

    Record from it with  --backend ni-grpc://127.0.0.1:31763.

    Example:  pianorig serve-sim --rig pcie6363 --port 31763
    """

    def announce(at: str, product: str, name: str) -> None:
        if as_json:
            print_json({"address": at, "product": product, "device": name, "clock": clock})
        else:
            print(f"virtual {product} {name} at {at} ({clock} clock); stop with Ctrl-C", flush=True)

    if client_ca is not None and tls is None:
        raise CommandInputError("--tls-client-ca: needs --tls CERT KEY beside it")
    secured = simulated.Tls(*tls, client_ca) if tls is not None else None
    options = simulated.ServeOptions(rig, host, port, clock, seed, bench, fault, hand, allow_network, secured, felt)
    if options.on_network and allow_network:
        who = "only holders of a certificate of the CA" if client_ca else "anybody who reaches it"
        print(f"warning: {host} is open to the network; {who} can drive this bench", file=sys.stderr, flush=True)
    simulated.serve_until_interrupted(options, announce, print_json if log else None)
