"""``pianorig sensitivity``: local table, Morris's screening and Sobol' indices of a blow, as tables and figures."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Executor
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

import model
from model.screening import (
    MARKS,
    LocalTable,
    Morris,
    Sobol,
    Spread,
    Variants,
    draw_local,
    draw_morris,
    draw_sobol,
    local_table,
    morris,
    sobol,
    spreads,
)
from model.screening.local import lines
from model.screening.members import Study
from model.screening.morris import check_ways
from model.screening.sobol import check_base
from pianorig.console.column_file import write_rows
from pianorig.console.output import nan_as_null, print_files
from pianorig.console.progress import bar, say, working
from pianorig.errors import CommandInputError
from pianorig.workflows.model.cluster import cluster_executor
from pianorig.workflows.model.force_input import DrivingForce, read_driving_force

MOST_LINES = 20
HEADINGS = {
    "let_off_m": "let-off", "strike_m_per_s": "speed", "check_m": "check", "drop_s": "drop time",
    "key curve": "key curve", "hammer curve": "hammer c.",
}  # fmt: skip
SHOWN = ("let_off_m", "strike_m_per_s", "check_m", "drop_s")  # what is printed; files hold all
SCREENED = 10  # parameters that --morris and --sobol vary where none are named
Array = NDArray[np.float64]

DIRECTION = (".normal.x", ".normal.y")


@dataclass(frozen=True)
class SensitivityOrder:
    """What is asked for.

    Attributes
    ----------
    parameters : names; None for all that do something in the blow
    morris, sobol : ways, base members; None where not asked for
    uncertainties : name -> standard uncertainty instead of the declared
    seed : of the variants
    workers : threads; None for one per processor
    cluster : address of a Dask scheduler
    """

    parameters: list[str] | None = None
    morris: int | None = None
    sobol: int | None = None
    uncertainties: Mapping[str, float] = field(default_factory=dict)
    seed: int = 0
    workers: int | None = None
    cluster: str | None = None


def study_sensitivity(
    action: model.Action, blow: Path, trial: int | None, order: SensitivityOrder, out: Path | None, quiet: bool
) -> dict[str, Any]:
    """Compute, print and write what is ordered for one blow.

    Parameters
    ----------
    action : parameter set
    blow : session, sealed trial or CSV table
    trial : trial of a session; by default the first that is not rejected
    order : what to compute
    out : folder for tables, figures and finished members
    quiet : print nothing

    Raises
    ------
    CommandInputError : blow, trial or cluster cannot be used
    model.InputError : a parameter is unknown, without effect or without uncertainty
    """
    _check(action, order)
    source = _trial_of(blow, trial)
    driving = read_driving_force(source)
    with _executor(order) as executor:  # before anything is written: a cluster may not be there
        local = _local(action, driving, order.parameters, quiet)
        facts: dict[str, Any] = {"action": action.name, "blow": source, "local": [nan_as_null(r) for r in local.rows()]}
        if not quiet:
            _print_local(local)
        files = _written(out, "local", local.rows(), lambda path: draw_local(local, path))
        if order.morris is not None or order.sobol is not None:
            chosen = _spreads(action, local, order)
            variants = Variants(
                action, driving.time_s, driving.force_n, tuple(s.parameter for s in chosen), driving.preload_n
            )
            for study in _studies(order, chosen):
                found = _computed(study, variants, (executor, order, out, quiet))
                rows = study.rows(found)
                facts[study.name] = [nan_as_null(row) for row in rows]
                files += _written(out, study.name, rows, partial(study.draw, found))
                if not quiet:
                    study.show(found)
    if not quiet:
        print_files(files)
    facts["files"] = files
    return facts


class _Kind(NamedTuple):
    """A kind of study: how it is called, computed, and shown."""

    name: str
    label: str
    compute: Callable[[Callable[[Array], Array]], Any]
    rows: Callable[[Any], list[dict[str, Any]]]
    draw: Callable[[Any, Path], None]
    show: Callable[[Any], None]


def _studies(order: SensitivityOrder, chosen: list[Spread]) -> list[_Kind]:
    """The studies ordered."""
    out, (ways, base) = [], (order.morris, order.sobol)
    if ways is not None:
        screen = partial(morris, chosen, quantities=MARKS, ways=ways, seed=order.seed)
        out.append(_Kind("morris", "screening", lambda f: screen(compute=f), morris_rows, draw_morris, _print_morris))
    if base is not None:
        share = partial(sobol, chosen, quantities=MARKS, n=base, seed=order.seed)
        out.append(_Kind("sobol", "Sobol' members", lambda f: share(compute=f), sobol_rows, draw_sobol, _print_sobol))
    return out


def _check(action: model.Action, order: SensitivityOrder) -> None:
    """Refuse, before anything is computed or written, what no study can be made of."""
    if order.morris is not None:
        check_ways(order.morris)
    if order.sobol is not None:
        check_base(order.sobol)
    if order.workers is not None and order.workers < 1:
        raise CommandInputError(f"--workers {order.workers}: allowed 1 or more")
    if order.parameters is not None and (order.morris is not None or order.sobol is not None):
        spreads(action, order.parameters, order.uncertainties)


def _trial_of(blow: Path, trial: int | None) -> Path:
    """File of the force: of a session the trial wanted, by default its first that is not rejected."""
    if not blow.is_dir():
        if trial is not None:
            raise CommandInputError(f"--trial {trial}: goes with a session; {blow} is no folder")
        return blow
    from rig.session.folder import Session  # start-up: h5py and pandas cost 0.4 s that a table does not need

    session = Session.open(blow)
    if trial is not None:
        return session.trial(trial).path
    usable = [one for one in session.trials if one.rejected is None]
    if not usable:
        raise CommandInputError(f"{blow}: all its trials are rejected; name one with --trial")
    return usable[0].path


def _local(action: model.Action, driving: DrivingForce, names: list[str] | None, quiet: bool) -> LocalTable:
    for name in names or ():
        if name.endswith(DIRECTION) and name in action.quantities:
            raise CommandInputError(
                f"--parameters {name}: is fixed by the geometry, as one component of a direction of length 1; leave it "
                "out, or name a position of the same contact"
            )
    wanted = model.sensitivity.effective_paths(action) if names is None else names
    options = model.SensitivityOptions(rest_input=driving.preload_n, allow_idle=names is None)
    with working(f"differentiating a blow by {len(wanted)} parameters", quiet):
        found = model.sensitivities(action, (driving.time_s, driving.force_n), wanted, options=options)
    if found.at_kink and not quiet:
        say(f"at rest {', '.join(found.at_kink)} only just touches: the table holds on that side alone")
    return local_table(found)


def _spreads(action: model.Action, local: LocalTable, order: SensitivityOrder) -> list[Spread]:
    """Parameters to vary: those named, or those that do most per declared uncertainty."""
    if order.parameters is not None:
        return spreads(action, order.parameters, order.uncertainties)
    size = np.max(np.nan_to_num(np.abs(local.per_u) / np.abs(local.values)), axis=1)
    most = [local.parameters[i] for i in np.argsort(-size, kind="stable")[:SCREENED] if size[i] > 0.0]
    return spreads(action, list(dict.fromkeys([*most, *order.uncertainties])), order.uncertainties)


@contextmanager
def _executor(order: SensitivityOrder) -> Iterator[Executor | None]:
    if order.cluster is None:
        yield None
        return
    with cluster_executor(order.cluster) as executor:
        yield executor


def _computed(
    study: _Kind, variants: Variants, where: tuple[Executor | None, SensitivityOrder, Path | None, bool]
) -> Any:
    """Carry out a study, its members on the executor or on threads, with a bar; say how to go on after Ctrl-C."""
    executor, order, out, quiet = where
    with bar(study.label, quiet, "blows") as progress:
        told = None if quiet else lambda found: say(found.line() + "; after Ctrl-C the same command goes on")
        members = Study(executor, order.workers, progress, None if out is None else out / "members", told)
        return study.compute(lambda values: members.run(variants, values))


def _written(out: Path | None, name: str, rows: list[dict[str, Any]], draw: Any) -> list[Path]:
    if out is None:
        return []
    files = [out / f"{name}.csv", out / f"{name}.svg"]
    write_rows(files[0], rows)
    draw(files[1])
    return files


def morris_rows(found: Morris) -> list[dict[str, Any]]:
    """One row a quantity and parameter, in the quantity's unit per standard uncertainty, the largest first."""
    return [
        {
            "quantity": name, "parameter": found.parameters[j], "mu": float(found.mu[q, j]),
            "mu_star": float(found.mu_star[q, j]), "mu_star_low": float(found.mu_star_low[q, j]),
            "mu_star_high": float(found.mu_star_high[q, j]), "sigma": float(found.sigma[q, j]),
            "absent": float(found.absent[q]),
        }
        for q, name in enumerate(found.quantities)
        for j in np.argsort(np.nan_to_num(-found.mu_star[q]), kind="stable")
    ]  # fmt: skip


def sobol_rows(found: Sobol) -> list[dict[str, Any]]:
    """One row a quantity and parameter, the largest total index first."""
    return [
        {
            "quantity": name, "parameter": found.parameters[j], "first": float(found.first[q, j]),
            "first_low": float(found.first_low[q, j]), "first_high": float(found.first_high[q, j]),
            "total": float(found.total[q, j]), "total_low": float(found.total_low[q, j]),
            "total_high": float(found.total_high[q, j]), "mean": float(found.mean[q]),
            "deviation": float(found.deviation[q]), "absent": float(found.absent[q]),
        }
        for q, name in enumerate(found.quantities)
        for j in np.argsort(np.nan_to_num(-found.total[q]), kind="stable")
    ]  # fmt: skip


def _print_local(table: LocalTable) -> None:
    print("percent of a quantity per percent of a parameter")
    for line in lines(table, HEADINGS, MOST_LINES):
        print(line)
    if len(table.parameters) > MOST_LINES:
        print(f"and {len(table.parameters) - MOST_LINES} more, each with less; all in local.csv of --out")


def _print_morris(found: Morris) -> None:
    print("\nMorris: mean size of the effect of one standard uncertainty (sigma: curved or mixed with others)")
    _print_ranked(found.quantities, found.parameters, found.absent, found.mu_star, lambda q, j: (
        f"{found.mu_star[q, j]:.3g} ({found.mu_star_low[q, j]:.3g} to {found.mu_star_high[q, j]:.3g}), "
        f"sigma {found.sigma[q, j]:.2g}"))  # fmt: skip


def _print_sobol(found: Sobol) -> None:
    print("\nSobol': share of the variance, alone and in all, with 95 % intervals")
    _print_ranked(found.quantities, found.parameters, found.absent, found.total, lambda q, j: (
        f"{found.first[q, j]:.3f} ({found.first_low[q, j]:.3f} to {found.first_high[q, j]:.3f}), in all "
        f"{found.total[q, j]:.3f} ({found.total_low[q, j]:.3f} to {found.total_high[q, j]:.3f})"))  # fmt: skip


def _print_ranked(
    quantities: tuple[str, ...], parameters: tuple[str, ...], absent: Array, size: Array, words: Any
) -> None:
    """The five strongest parameters of each quantity, a line each."""
    for q, name in enumerate(quantities):
        if name not in SHOWN:
            continue
        lost = f" (missing in {100.0 * absent[q]:.1f} % of the members)" if absent[q] else ""
        if np.all(np.isnan(size[q])):
            print(f"{name}: nothing to say{lost}")
            continue
        print(f"{name}{lost}")
        for j in np.argsort(np.nan_to_num(-size[q]), kind="stable")[:5]:
            print(f"  {parameters[j]:<32} {words(q, j)}")
