"""A loading experiment and its fit on one sheet, after Figs 2.5 and 2.6 of the thesis."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from model.calibration.curve import LoadingCurve
from model.calibration.felt import Damping, FeltFit
from model.files.figure_sheet import new_sheet


def draw(curve: LoadingCurve, fit: FeltFit, dampings: dict[str, Damping], title: str, path: str | Path) -> None:
    """Write a figure of the loading experiment, its cubic and the loops of ``dampings`` (name of a blow -> D) to
    ``path`` (.svg, .pdf or .png), in place of a file that is there.

    Parameters
    ----------
    curve, fit : what was measured and fitted
    dampings : name of a blow -> D found with its speeds
    title : for the sheet
    path : file to write, .svg, .pdf or .png

    Raises
    ------
    InputError : the file cannot be written

    Examples
    --------
    >>> import model
    >>> curve = model.calibration.read_curve("felt.csv")
    >>> model.calibration.figure.draw(curve, model.calibration.fit_felt(curve), {}, "contact02", "felt.svg")
    """
    with new_sheet(path, 10.0, 4.4) as sheet:
        measured, fitted = sheet.subplots(1, 2, sharex=True, sharey=True)
        for axes in (measured, fitted):
            axes.plot(1e3 * curve.loading_m, curve.loading_n, ".", color="C0", ms=4, label="loading, measured")
            axes.plot(1e3 * curve.unloading_m, curve.unloading_n, "x", color="C1", ms=4, label="unloading, measured")
            axes.set_xlabel("displacement, mm")
            axes.grid(alpha=0.3)
        x = np.linspace(0.0, fit.measured_m[1], 200)
        basis = np.column_stack([x**3, x**2, x])
        u = np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", basis, fit.covariance, basis), 0.0))
        force = fit.force_n(x)
        fitted.plot(1e3 * fit.mid_m, fit.mid_n, color="0.35", lw=1.0, ls=":", label="mid-line")
        fitted.plot(1e3 * x, force, color="k", lw=1.6, label="fit, eq. 2.5")
        fitted.fill_between(
            1e3 * x, force - 1.96 * u, force + 1.96 * u, color="k", alpha=0.18, lw=0, label="95 % of the fit"
        )
        for k, (blow, one) in enumerate(dampings.items()):
            swing = one.d * one.speed_m_per_s
            label = f"{blow}: D = {one.d:.3g} s/m at ±{one.speed_m_per_s:.3g} m/s"
            for sign, name in ((1.0, label), (-1.0, None)):
                fitted.plot(1e3 * x, force * (1.0 + sign * swing), color=f"C{k + 2}", ls="--", lw=1.0, label=name)
            fitted.axvline(1e3 * one.at_m, color="0.7", lw=0.8)
        measured.set(ylabel="force, N", title=f"{title}: loading and unloading")
        fitted.set_title("mid-line and its cubic")
        for axes in (measured, fitted):
            axes.legend(fontsize="small", loc="upper left")
