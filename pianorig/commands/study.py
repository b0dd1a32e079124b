"""``pianorig study``: what-if variants of an action under one blow, and five studies by name, as tables and figures.

A study is a function of an action and a blow to what it found; writing, printing and JSON are the same for all.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import typer

import model
from pianorig import workflows
from pianorig.console.column_file import make_folder, write_rows
from pianorig.console.options import DEFAULT_ACTION, AsJson, Scale, Scene, Settings
from pianorig.console.output import file_lines, tell
from pianorig.console.overrides import in_scene, load_changed, read_variant, say_idle
from pianorig.console.progress import working
from pianorig.errors import CommandInputError

Rows = list[dict[str, Any]]

WORDS = {
    "strike_ms": "strike ms",
    "bottom_ms": "bottom ms",
    "free_flight_ms": "free ms",
    "strike_m_per_s": "strike m/s",
    "contact_ms": "contact ms",
    "rebound": "rebound",
    "check_mm": "check mm",
    "down_n": "down N",
    "let_off_n": "let-off N",
    "give_mm": "give mm",
    "peak_n": "peak N",
    "loss_mj": "loss mJ",
    "share": "share",
    "height": "height",
}
SWEPT = ("strike_ms", "bottom_ms", "free_flight_ms", "strike_m_per_s", "rebound", "check_mm", "give_mm")
SHARES = (0.25, 0.5, 1.0, 2.0)  # of the blow's own speed, with which hammers meet the string
FRICTION_HEAD = ("friction", "strike", "speed", "hold", "moves in it", "differs by", "until release")
FRICTION_UNITS = ("", "ms", "m/s", "mm", "mm/s", "rad", "rad")


class Found(NamedTuple):
    """What a study gives.

    Attributes
    ----------
    lines : to print
    tables : name of a CSV file, without its ending -> rows
    facts : name in the JSON -> table of that name, or a number
    figure : name of the sheet, and what draws it
    """

    lines: list[str]
    tables: dict[str, Rows]
    facts: dict[str, Any]
    figure: tuple[str, Callable[[Path], None]] | None = None


def command(
    action: Annotated[
        str,
        typer.Argument(
            help="Built-in action or a TOML file; or the word thesis: its Figs 4.9-4.11, 4.16-4.19; or the word "
            "friction-limit: threshold speeds beside set-valued friction; or the word string: its bar beside a string; "
            "or the word felt-law: the blow under each law of felt; or the word joints: the blow with joints that give."
        ),
    ],
    force: Annotated[
        Path | None,
        typer.Option(
            "--force", help="CSV of time_s,force_n, or a sealed trial; after one of the words: another forte."
        ),
    ] = None,
    variant: Annotated[
        list[str] | None,
        typer.Option("--variant", help='One variant, "name: --set path=value --scale name=factor"; may be repeated.'),
    ] = None,
    set_: Settings = None,
    scale: Scale = None,
    scene: Scene = None,
    of: Annotated[
        str | None,
        typer.Option("--of", help=f"With one of the words: the action to study; default {DEFAULT_ACTION}."),
    ] = None,
    out: Annotated[Path | None, typer.Option("--out", help="Folder for the figure and the tables.")] = None,
    as_json: AsJson = False,
) -> None:
    """Ask what if: variants of an action under one blow.

    Example:  pianorig study hirschkorn2004 --force force.csv --variant "dry: --scale damping=0.1" --out dry
    """
    make_folder(out)
    if action in STUDIES:
        if variant:
            raise CommandInputError(f"study {action}: has its own variants; leave out --variant or name an action")
        if scene is not None and action != "thesis":
            raise CommandInputError(f"study {action}: has its own scenes; leave out --scene or name an action")
        chosen = in_scene(load_changed(of or DEFAULT_ACTION, set_, scale, scene), scene)
        if force is None or action != "friction-limit":  # blows on the key; that one takes what drives its scene
            model.choice_of(chosen).need_played_key(chosen.name)
        words, study, forte = STUDIES[action]
    else:
        if of is not None:
            raise CommandInputError(
                f"--of {of}: goes with thesis, friction-limit, string, felt-law and joints only; "
                f"name the action instead of {action}"
            )
        if force is None:
            raise CommandInputError(
                "--force: missing; name a CSV file with the columns time_s,force_n, or a sealed trial"
            )
        chosen = in_scene(load_changed(action, set_, scale, scene), scene)
        variants = [model.study.Variant(*read_variant(text)) for text in variant or []]
        say_idle(chosen, [name for one in variants for name in (*one.values, *one.factors)])
        words, study, forte = f"simulating {len(variants) + 1} blows", partial(_variants, variants), ""
    driving = None if force is None else workflows.read_driving_force(force, model.choice_of(chosen).input_column)
    blow = model.force_table(forte) if driving is None else (driving.time_s, driving.force_n)
    with working(words, as_json):
        found = study(chosen, *blow)
    files: list[Path] = []
    if out is not None:
        if found.figure is not None:
            name, draw = found.figure
            files.append(out / name)
            draw(files[0])
        for name, rows in found.tables.items():
            files.append(out / f"{name}.csv")
            write_rows(files[-1], rows)
    given = {} if action in STUDIES else {"force_table": force}
    facts = {"action": chosen.name, **given, **found.facts, "files": files}
    tell(as_json, facts, [*found.lines, *file_lines(files)])


def _variants(variants: Sequence[model.study.Variant], action: model.Action, time_s: Any, force_n: Any) -> Found:
    """Variants of an action; under a trial the arm's preload acts from the first sample on."""
    study = model.study.compare(action, time_s, force_n, variants)
    rows = study.rows()
    return Found(
        _study_lines(study),
        {"variants": rows},
        {"variants": rows},
        ("study.svg", partial(model.study.draw_study, study)),
    )


def _thesis(action: model.Action, time_s: Any, force_n: Any) -> Found:
    studies = model.study.thesis_studies(action, (time_s, force_n))
    lines = []
    for blow, study in (("piano", studies.piano), ("forte", studies.forte)):
        lines += [f"{action.name}, {blow}", *_study_lines(study), ""]
    confirmed = sum(o.holds for o in studies.observations)
    lines.append(f"observations of the thesis: {confirmed} of {len(studies.observations)} hold here")
    for o in studies.observations:
        place = f"{'Sec.' if o.figure == '4.4' else 'Fig.'} {o.figure}"
        lines.append(f"{'holds' if o.holds else 'NOT':<6} {place:<10} {o.statement}")
        lines.append(f"{'':<17} {o.judged_by}: {o.found:.3g}{f' {o.unit}' if o.unit else ''} (allowed {o.allowed})")
    observations = [asdict(o) for o in studies.observations]
    tables: dict[str, Rows] = {"observations": observations}
    tables |= {"piano": studies.piano.rows(), "forte": studies.forte.rows()}
    return Found(lines, tables, tables, ("thesis.svg", partial(model.study.draw_thesis, studies)))


def _study_lines(study: model.study.Study) -> list[str]:
    """One line per variant."""
    width = max(12, *(len(v.name) for v in study.variants))
    lines = [
        f"{'variant':<{width}}  {'strike s':>9} {'m/s':>6} {'strikes':>7} {'held':>5} {'hold mm':>8} {'moved mm':>9}"
        f" {'lever':>6} {'RMS deg':>8}"
    ]
    for row in study.rows():
        cells: dict[str, Any] = {k: math.nan if v is None else v for k, v in row.items()}
        line = (
            f"{cells['variant']:<{width}}  {cells['strike_s']:>9.4f} {cells['strike_m_per_s']:>6.3f} "
            f"{cells['strikes']:>7} {'yes' if cells['held'] else 'no':>5} {1e3 * cells['hold_m']:>8.2f} "
            f"{1e3 * cells['hold_moved_m']:>9.3f} {cells['lever_bounces']:>6} "
            f"{math.degrees(cells['hammer_rms_rad']):>8.3f}"
        )
        lines.append(line.replace("nan", "  -"))
    return [
        *lines,
        "hold: hammer to string; moved: in the last 0.1 s of the hold; lever: contacts of knuckle and lever meanwhile;",
        "RMS: difference of the hammer's angle from the action as given",
    ]


def _friction_limit(action: model.Action, time_s: Any, force_n: Any) -> Found:
    from model.stick_slip.limit import draw  # start-up: NumPy, which --help does not need

    limit = model.stick_slip.compare(action, time_s, force_n)
    lines = [
        f"{action.name}: eq. 2.10 with falling threshold speed, and set-valued friction in steps of",
        f"{1e6 * limit.marched.step_s:g} us (its own error, step halved: {limit.march_error_rad:.1e} rad)",
    ]
    rows = []
    names = [f"v_t {v:g} m/s" for v in limit.v_t] + ["set-valued"]
    table: list[tuple[str, ...]] = [FRICTION_HEAD, FRICTION_UNITS]
    for name, solution, m in zip(names, (*limit.smoothed, limit.marched.solution), limit.measures, strict=True):
        row: dict[str, Any] = {
            "friction": name,
            "strike_s": m.strike_s,
            "strike_m_per_s": m.strike_m_per_s,
            "held": m.held,
            "hold_m": m.hold_m,
            "creep_m_per_s": limit.creep_m_per_s(solution),
            "differs_rad": limit.away_rad(solution),
            "differs_until_release_rad": limit.away_until_release_rad(solution),
        }
        rows.append(row)
        numbers = (
            f"{1e3 * row['strike_s']:.4f}",
            f"{row['strike_m_per_s']:.5f}",
            f"{1e3 * row['hold_m']:.4f}" + ("" if row["held"] else "*"),
            f"{1e3 * row['creep_m_per_s']:+.4f}",
            f"{row['differs_rad']:.1e}",
            f"{row['differs_until_release_rad']:.1e}",
        )
        table.append((name, *numbers))
    lines += [f"{cells[0]:<14}" + "".join(f"{cell:>14}" for cell in cells[1:]) for cells in table]
    lines += [] if all(row["held"] for row in rows) else ["* not held by the back check"]
    facts = {"march_error_rad": limit.march_error_rad, "friction": rows}
    return Found(lines, {"friction_limit": rows}, facts, ("friction_limit.svg", partial(draw, limit)))


def _string(action: model.Action, time_s: Any, force_n: Any) -> Found:
    """An action's hammer on its bar, on a string, on a choir; the action on bar and string."""
    hammer, speed = model.string.hammer_at_the_string(action, time_s, force_n)
    blows = model.string.compare_with_bar(hammer, [share * speed for share in SHARES], model.string.C4)
    effects = model.study.string_effects(action, time_s, force_n)
    lines = [
        f"{action.name}: hammer of {1e3 * hammer.mass_kg:.3g} g at the string, {speed:.3g} m/s under this force;",
        "bar as in the model, one C4 string, a choir of three 0.5 cents apart, with the felt of contact12",
        f"{'':<8}{'speed':>8}{'contact':>9}{'touches':>9}{'peak':>8}{'rebound':>9}{'slope':>11}{'modes':>7}",
        f"{'':<8}{'m/s':>8}{'ms':>9}{'':>9}{'N':>8}{'':>9}{'dB/octave':>11}",
    ]
    for blow in blows:
        slope = "-" if blow.slope_db_per_octave != blow.slope_db_per_octave else f"{blow.slope_db_per_octave:.1f}"
        lines.append(
            f"{blow.against:<8}{blow.speed_m_per_s:>8.3g}{1e3 * blow.contact_s:>9.2f}{blow.n_contacts:>9}"
            f"{blow.peak_n:>8.3g}{blow.rebound:>9.3f}{slope:>11}{blow.n_modes or '-':>7}"
        )
    lines += ["\nthe whole action under this force; +- from the declared numbers of the string", *effect_lines(effects)]
    rows, inside = [asdict(blow) for blow in blows], effect_rows(effects)
    facts = {"hammer_kg": hammer.mass_kg, "speed_m_per_s": speed, "blows": rows, "in_the_action": inside}
    return Found(lines, {"string": rows, "string_in_the_action": inside}, facts)


def _felt_law(action: model.Action, time_s: Any, force_n: Any) -> Found:
    effects = model.study.felt_law_effects(action, time_s, force_n)
    equal = model.study.effects_at_equal_loss(action, time_s, force_n)
    lines = [
        f"{action.name}: the law of felt changed, slow loading curves and everything else as they are;",
        "+- standard uncertainty from the declared numbers of the law",
        *effect_lines(effects),
        "\nthe same with equal peak force and equal loss of the felt (the first of all three): what is left is the",
        "memory's own; share: fitted epsilon or beta, height: of the slow curve; +- from tau or eta, fitted again",
        *effect_lines(equal),
    ]
    rows, equal_rows = effect_rows(effects), effect_rows(equal)
    facts = {"effects": rows, "equal_loss": equal_rows}
    return Found(lines, {"felt_law": rows, "felt_law_equal_loss": equal_rows}, facts)


def _joints(action: model.Action, time_s: Any, force_n: Any) -> Found:
    """A blow with joints that give, one at a time and together, and over their stiffness."""
    effects = model.study.joint_effects(action, time_s, force_n)
    swept: Rows = [
        {"factor": factor, **marks} for factor, marks in model.study.joint_sweep(action, time_s, force_n).items()
    ]
    lines = [
        f"{action.name}: joints that give, everything else as it is; their numbers are guesses, a stiffness within",
        "a factor of five: +- standard uncertainty from these guesses",
        *effect_lines(effects, ("joint", "")),
        "\nall five, their stiffness times a factor (dampings times its root)",
        f"{'factor':<8}" + "".join(f"{WORDS[name]:>12}" for name in SWEPT) + "  held",
    ]
    for row in swept:
        head = f"{row['factor']:g}" if row["factor"] else "rigid"
        lines.append(f"{head:<8}{''.join(f'{row[name]:>12.4g}' for name in SWEPT)}  {'yes' if row['held'] else 'no'}")
    lines += [
        "\nThe thesis (5.2): bushings 'were modelled as perfect revolute joints, though it is known that there is",
        "some movement'; the key's on its rail 'caused a noticeable discrepancy in the key position measurement'",
    ]
    rows = effect_rows(effects)
    return Found(lines, {"joints": rows, "joints_stiffness": swept}, {"effects": rows, "stiffness": swept})


def effect_rows(effects: Sequence[model.study.Effect]) -> Rows:
    """One plain row for each effect, values beside their uncertainties."""
    return [
        {"of": e.of, "law": e.law, "held": e.held}
        | {key: number for name in e.value for key, number in ((name, e.value[name]), (f"u_{name}", e.u[name]))}
        for e in effects
    ]


def effect_lines(effects: Sequence[model.study.Effect], first: tuple[str, str] = ("felt", "law")) -> list[str]:
    """A table of effects; a dash for what did not happen; ``first`` heads what they are of."""
    names = [name for name in WORDS if name in effects[0].value]
    wide = max(11, *(len(e.of) + 1 for e in effects))
    lines = [f"{first[0]:<{wide}}{first[1]:<14}" + "".join(f"{WORDS[name]:>16}" for name in names) + "  held"]
    for e in effects:
        cells = "".join(f"{_cell(e.value[name], e.u[name]):>16}" for name in names)
        lines.append(f"{e.of:<{wide}}{e.law:<14}{cells}  {'yes' if e.held else 'no'}")
    return lines


def _cell(value: float, u: float) -> str:
    if value != value:
        return "-"
    digits = 4 if abs(value) >= 100.0 else 3
    return f"{value:.{digits}g}" if not u > 1e-6 * abs(value) else f"{value:.{digits}g}+-{u:.1g}"


STUDIES: dict[str, tuple[str, Callable[..., Found], str]] = {
    "thesis": ("repeating the studies of the thesis, Sections 4.2.2 and 4.4", _thesis, "thesis-forte"),
    "friction-limit": ("integrating with falling threshold speeds, then set-valued", _friction_limit, "thesis-forte"),
    "string": ("simulating the blow, then bar, string and choir", _string, "forte"),
    "felt-law": ("simulating the blow and a slow press under each law, then at equal loss", _felt_law, "forte"),
    "joints": ("simulating the blow with joints that give", _joints, "forte"),
}
"""What is done, the study, and the built-in force table that it takes where none is given."""
