"""Figures of a sensitivity study: the local table, Morris's plane, Sobol' indices with their intervals."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from model.files.figure_sheet import check_ending, new_sheet, save_sheet
from model.screening.local import LocalTable
from model.screening.morris import Morris
from model.screening.sobol import Sobol

MOST_ROWS = 20
TITLES = {
    "onset_s": "onset", "key_bottom_s": "key bottom", "let_off_s": "let-off time", "let_off_m": "let-off distance",
    "strike_s": "strike time", "strike_m_per_s": "hammer speed", "rebound_s": "rebound time",
    "rebound_m_per_s": "rebound speed", "check_s": "check time", "check_m": "check height", "drop_s": "drop time",
}  # fmt: skip
SHOWN = ("let_off_m", "strike_m_per_s", "check_m", "drop_s")
FIRST, TOTAL = "#0072B2", "#C04A00"


def draw_local(table: LocalTable, path: str | Path) -> None:
    """Write a map of percent per percent: parameters by events and curves, the most influential on top.

    Parameters
    ----------
    table : from `local_table`
    path : file to write, .svg, .pdf or .png

    Examples
    --------
    >>> import model
    >>> found = model.sensitivities("hirschkorn2004", model.force_table("forte"), ["hammer.mass", "friction"])
    >>> model.screening.draw_local(model.screening.local_table(found), "local.svg")
    """
    target = Path(path)
    check_ending(target)
    shown = table.percent[:MOST_ROWS]
    figure = new_sheet(2.5 + 0.62 * len(table.quantities), 2.4 + 0.28 * len(shown))
    axes = figure.subplots()
    # one strong parameter would leave the others without a colour
    limit = max(float(np.quantile(np.abs(shown), 0.9)), 1e-12)
    image = axes.imshow(shown, cmap="PuOr", vmin=-limit, vmax=limit, aspect="auto")
    for i, q in np.ndindex(*shown.shape):
        dark = abs(shown[i, q]) > 0.6 * limit
        axes.text(q, i, f"{shown[i, q]:.2g}", ha="center", va="center", fontsize=6, color="white" if dark else "black")
    axes.set_xticks(range(len(table.quantities)), [TITLES.get(n, n) for n in table.quantities], rotation=50, ha="right")
    axes.set_yticks(range(len(shown)), table.parameters[:MOST_ROWS])
    axes.tick_params(labelsize=8)
    axes.set_title("percent of a quantity per percent of a parameter", fontsize=9)
    figure.colorbar(image, ax=axes, shrink=0.6, extend="both")
    save_sheet(figure, target)


def _panels(quantities: Sequence[str]) -> list[int]:
    wanted = [quantities.index(name) for name in SHOWN if name in quantities]
    return wanted or list(range(min(4, len(quantities))))


def draw_morris(found: Morris, path: str | Path) -> None:
    """Write mu* with its interval and sigma for the main quantities, a panel each.

    Parameters
    ----------
    found : from `morris`
    path : file to write, .svg, .pdf or .png

    Examples
    --------
    >>> import model
    >>> spreads = model.screening.spreads(model.load_action(), ["hammer.mass", "key.mass"])
    >>> found = model.screening.morris(spreads, lambda values: values[:, :1], ["y"], ways=4)
    >>> model.screening.draw_morris(found, "morris.svg")
    """
    target = Path(path)
    check_ending(target)
    panels = _panels(found.quantities)
    figure = new_sheet(8.5, 0.5 + 4.0 * len(panels))
    for axes, q in zip(np.atleast_1d(figure.subplots(len(panels), 1)), panels, strict=True):
        size = found.mu_star[q]
        order = np.argsort(np.nan_to_num(-size))[:MOST_ROWS][::-1]
        y = np.arange(len(order))
        ends = np.abs(np.stack([found.mu_star_low[q], found.mu_star_high[q]]) - size)[:, order]
        axes.errorbar(size[order], y, xerr=ends, fmt="o", color=FIRST, capsize=2, label="mu*, 95 %")
        axes.plot(found.sigma[q][order], y, "|", color=TOTAL, markersize=9, label="sigma")
        axes.set_yticks(y, [found.parameters[i] for i in order], fontsize=7)
        name = found.quantities[q]
        axes.set_xlabel(f"change of {TITLES.get(name, name)} per standard uncertainty, {_unit_text(name)}", fontsize=8)
        axes.grid(alpha=0.3)
        axes.legend(fontsize=7)
    save_sheet(figure, target)


def draw_sobol(found: Sobol, path: str | Path) -> None:
    """Write first and total indices with their intervals for the main quantities, a panel each.

    Parameters
    ----------
    found : from `sobol`
    path : file to write, .svg, .pdf or .png

    Examples
    --------
    >>> import model
    >>> spreads = model.screening.spreads(model.load_action(), ["hammer.mass", "key.mass"])
    >>> found = model.screening.sobol(spreads, lambda values: values[:, :1], ["y"], n=64)
    >>> model.screening.draw_sobol(found, "sobol.svg")
    """
    target = Path(path)
    check_ending(target)
    panels = _panels(found.quantities)
    figure = new_sheet(8.5, 0.5 + 4.0 * len(panels))
    for axes, q in zip(np.atleast_1d(figure.subplots(len(panels), 1)), panels, strict=True):
        order = np.argsort(np.nan_to_num(-found.total[q]))[:MOST_ROWS][::-1]
        y = np.arange(len(order), dtype=float)
        for shift, color, name, index, low, high in (
            (0.15, FIRST, "first", found.first, found.first_low, found.first_high),
            (-0.15, TOTAL, "total", found.total, found.total_low, found.total_high),
        ):
            ends = np.abs(np.stack([low[q], high[q]]) - index[q])[:, order]
            axes.errorbar(index[q][order], y + shift, xerr=ends, fmt="o", ms=4, color=color, capsize=2, label=name)
        axes.set_yticks(y, [found.parameters[i] for i in order], fontsize=7)
        axes.axvline(0.0, color="0.6", linewidth=0.8)
        title = TITLES.get(found.quantities[q], found.quantities[q])
        axes.set_xlabel(f"share of the variance of {title}, 95 % intervals", fontsize=8)
        axes.grid(alpha=0.3)
        axes.legend(fontsize=7)
    save_sheet(figure, target)


def _unit_text(quantity: str) -> str:
    return "m/s" if quantity.endswith("_per_s") else quantity.rpartition("_")[2]
