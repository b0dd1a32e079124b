"""``pianorig regulate``: find the seven adjustments that bring an action to the regulation of the thesis."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def command(
    action: Annotated[str, typer.Argument(help="Built-in action or a TOML file.")],
    out: Annotated[
        Path | None, typer.Option("--out", help="TOML file to write; without it the action is only measured.")
    ] = None,
    set_: Annotated[
        list[str] | None, typer.Option("--set", help="Parameter to change first, path=value; may be repeated.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Measure and regulate an action: dip, hammer height, jack, repetition lever, let-off, drop, back check.

    Example:  pianorig regulate hirschkorn2004 --out regulated.toml
    """
    import model
    from model import regulation
    from pianorig.console.output import check_writable, print_json
    from pianorig.console.overrides import read_settings
    from pianorig.errors import InputError

    if out is not None:
        if out.suffix != ".toml":
            raise InputError(f"{out}: ending found {out.suffix!r}, allowed .toml")
        check_writable(out)
    given = model.load_action(action, read_settings(set_ or []))
    rows: list[dict[str, object]]
    if out is None:
        seen = regulation.measure(given)
        rows = [
            {
                "target": t.name,
                "words": t.words,
                "wanted_m": t.wanted_m,
                "measured_m": _known(seen.value_m[t.name]),
                "remark": seen.remarks.get(t.name),
            }
            for t in regulation.TARGETS
        ]
        if as_json:
            print_json({"action": given.name, "targets": rows})
            return
        print(f"{given.name}: {'target':<46}  wanted  measured   (mm)")
        for t in regulation.TARGETS:
            remark = seen.remarks.get(t.name)
            value = _millimetres(seen.value_m[t.name], 8)
            print(f"  {t.words:<58}{_millimetres(t.wanted_m, 8)}  {value}{f'   {remark}' if remark else ''}")
        return
    done = regulation.regulate(given)
    regulation.write_action(
        done.action,
        out,
        [
            f"{done.action.name}: {given.name} regulated by `pianorig regulate` to the targets of Hirschkorn (2004), "
            "Section 2.3.",
            "Seven quantities differ from the given set; their source begins with 'regulated'. u of these: what",
            "changes the target by its tolerance of 0.02 mm (rectangular).",
        ],
    )
    rows = [
        {
            "target": t.name,
            "words": t.words,
            "wanted_m": t.wanted_m,
            "before_m": _known(done.before.value_m[t.name]),
            "after_m": _known(done.after.value_m[t.name]),
            "screw": s.name,
            "path": s.path,
            "turned_m": done.turned_m[t.name],
        }
        for t, s in zip(regulation.TARGETS, regulation.SCREWS, strict=True)
    ]
    if as_json:
        print_json({"action": done.action.name, "out": out, "targets": rows, "looks": done.looks})
        return
    print(f"{'target':<46}  wanted   before    after  {'screw':<20}  turned  (mm)")
    for t, s in zip(regulation.TARGETS, regulation.SCREWS, strict=True):
        before, after = done.before.value_m[t.name], done.after.value_m[t.name]
        print(
            f"{t.words:<46}{_millimetres(t.wanted_m, 8)} {_millimetres(before, 8)} {_millimetres(after, 8)}"
            f"  {s.name:<20} {1e3 * done.turned_m[t.name]:+7.3f}"
        )
    print(f"{out}: {done.action.name}")


def _known(value: float) -> float | None:
    return value if value == value else None


def _millimetres(value: float, width: int) -> str:
    # + 0.0 so that a tiny negative number does not read -0.00
    return f"{'-':>{width}}" if value != value else f"{round(1e3 * value, 2) + 0.0:>{width}.2f}"
