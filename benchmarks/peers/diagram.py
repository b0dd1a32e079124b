"""The diagram: error against run time, one panel per blow, logarithmic on both axes.

Ours are thick solid lines with filled markers, peers thin dashed lines with open markers; colours (Okabe and Ito) are
distinguishable by colour-blind readers, and no two methods share a marker.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from benchmarks.peers.race import Row

OURS = ("#0072B2", "#D55E00", "#009E73", "#000000", "#CC79A7")
OUR_MARKS = "osDP*"
PEERS = {
    "CVODE from C": ("#000000", "^"),
    "scikit-sundae CVODE": ("#CC79A7", "v"),
    "SciPy odeint (LSODA)": ("#E69F00", "<"),
    "SciPy LSODA": ("#009E73", ">"),
    "CasADi CVODES": ("#56B4E9", "h"),
    "diffrax Kvaerno5": ("#CC79A7", "p"),
    "SciPy BDF": ("#666666", "x"),
    "SciPy Radau": ("#666666", "+"),
    "explicit DOP853 compiled": ("#999999", "d"),
    "plain NumPy with LSODA": ("#D55E00", "*"),
}


def draw(rows: Sequence[Row], blows: Sequence[str], default: str, path: Path) -> None:
    """Write the diagram of ``rows`` to ``path`` (SVG, or whatever its suffix says)."""
    import matplotlib

    matplotlib.use("Agg")
    matplotlib.rcParams.update({"svg.fonttype": "none", "svg.hashsalt": "work-precision", "font.size": 9})
    import matplotlib.pyplot as plt
    from matplotlib.ticker import LogLocator

    columns = min(3, len(blows) + 1)
    lines = -(-(len(blows) + 1) // columns)
    figure, axes = plt.subplots(
        lines, columns, figsize=(3.6 * columns, 3.5 * lines), sharex=True, sharey=True, squeeze=False
    )
    panels = list(axes.flat)
    handles: dict[str, object] = {}
    methods = list(dict.fromkeys(r.method for r in rows))
    ours = [m for m in methods if any(r.ours for r in rows if r.method == m)]
    ours.sort(key=lambda m: m != default)
    for panel, blow in zip(panels, blows, strict=False):
        for method in [*(m for m in methods if m not in ours), *reversed(ours)]:
            points = sorted(
                (r.tolerance, r.error_rad, r.best_s * 1e3) for r in rows if r.blow == blow and r.method == method
            )
            if not points:
                continue
            if method in ours:
                k = ours.index(method) % len(OURS)
                style = {"color": OURS[k], "marker": OUR_MARKS[k], "lw": 2.2, "ms": 5, "ls": "-", "zorder": 3}
            else:
                colour, mark = PEERS.get(method, ("#666666", "."))
                face = {} if mark in "x+" else {"mfc": "white"}
                style = {"color": colour, "marker": mark, "lw": 1.0, "ms": 5, "ls": "--", **face}
            (handles[method],) = panel.plot([p[1] for p in points], [p[2] for p in points], label=method, **style)
        panel.set_title(blow, loc="left", fontsize=10, fontweight="bold")
        panel.set_xscale("log")
        panel.set_yscale("log")
        panel.grid(True, which="major", color="#dddddd", lw=0.6)
        panel.xaxis.set_major_locator(LogLocator(numticks=7))
        panel.minorticks_off()
        panel.tick_params(labelbottom=True, labelleft=True)
        panel.set_xlabel("largest angle error, rad")
        panel.set_ylabel("run time, ms")
    panels[0].invert_xaxis()
    for panel in panels[len(blows) :]:
        panel.set_axis_off()
    order = [*ours, *(m for m in PEERS if m in handles)]
    panels[len(blows)].legend(
        [handles[m] for m in order],
        [m.replace("ours ", "ours, ") + (" (default)" if m == default else "") for m in order],
        loc="center",
        frameon=False,
        fontsize=9,
        handlelength=3.2,
        title="0.7 s of motion, one core;\nlower right is better",
    )
    figure.tight_layout()
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, metadata={"Date": None} if path.suffix == ".svg" else None, dpi=110)
    plt.close(figure)
    if path.suffix == ".svg":  # a hundredth of a point is enough and halves the file size
        text = path.read_text(encoding="utf-8")
        text = re.sub(r"\d+\.\d{3,}", lambda number: f"{float(number[0]):.2f}".rstrip("0").rstrip("."), text)
        path.write_text(text, encoding="utf-8")
