"""``pianorig serve-sim``: the virtual bench as a network device for any client of the NI gRPC Device Server."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def command(
    port: Annotated[int, typer.Option("--port", min=0, max=65535, help="TCP port; 0 takes a free one.")] = 31763,
    host: Annotated[str, typer.Option("--host", help="Address to listen on; others than this computer's see it.")] = (
        "127.0.0.1"
    ),
    rig: Annotated[str, typer.Option("--rig", help="Built-in rig or TOML file: product, device name.")] = "virtual",
    clock: Annotated[str, typer.Option("--clock", help="real, virtual (as fast as it is read), or a speed.")] = "real",
    seed: Annotated[int | None, typer.Option("--seed", min=0, help="Seed of everything that scatters.")] = None,
    bench: Annotated[Path | None, typer.Option("--bench", help="Bench file; default: the built-in one.")] = None,
    fault: Annotated[
        str | None, typer.Option("--fault", help="Faults to plant, e.g. overwrite@1/0.5 (trial/seconds).")
    ] = None,
    hand: Annotated[
        bool, typer.Option("--hand", help="Let the virtual operator's hand act when a self-test asks for it.")
    ] = False,
    log: Annotated[bool, typer.Option("--log", help="Print a JSON line when outputs become live or safe.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print the address as JSON.")] = False,
) -> None:
    """Serve the virtual DAQ device over TCP until Ctrl-C; record with  --backend ni-grpc://127.0.0.1:31763.

    Example:  pianorig serve-sim --port 31763 --clock real
    """
    import json

    from pianorig.console.output import print_json
    from rig.simulated.serve import ServeOptions, serve_until_interrupted

    def announce(at: str, product: str, name: str) -> None:
        if as_json:
            print_json({"address": at, "product": product, "device": name, "clock": clock})
        else:
            print(f"virtual {product} {name} at {at} ({clock} clock); stop with Ctrl-C")
        _flush()

    def tell(state: dict[str, object]) -> None:
        print(json.dumps(state))
        _flush()

    options = ServeOptions(rig=rig, host=host, port=port, clock=clock, seed=seed, bench=bench, fault=fault, hand=hand)
    serve_until_interrupted(options, announce, tell if log else None)


def _flush() -> None:
    import sys

    sys.stdout.flush()
