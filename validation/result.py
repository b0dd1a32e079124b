"""`ValidationResult`: everything the report shows, as data frames, for use in a notebook.

Conventions: SI and rad; degrees and millimetres appear only in the report.
"""

from __future__ import annotations

import html
import textwrap
import warnings
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from model.tabular import unit_of
from validation.conventions import BODIES, FILM_CHANNELS, Array
from validation.curves.marks import Mark, trial_marks
from validation.curves.table import curve_table, curves_netcdf, write_curves
from validation.errors import ValidationInputError
from validation.events.session_events import Window

if TYPE_CHECKING:
    from matplotlib.axes import Axes

DIFFERS, DIFFERS_LITTLE = "differs", "differs, by less than matters"
DIFFERS_PERHAPS = "differs, whether by enough to matter cannot be told"
AGREES, CANNOT_TELL = "agrees", "cannot tell"
OUTCOMES = (DIFFERS, DIFFERS_LITTLE, DIFFERS_PERHAPS, AGREES, CANNOT_TELL)
"""What a verdict can be, in the order in which it is decided (`validation.verdict.verdict`)."""

WIDTH = 110  # of a line of `repr`
MOST_WARNINGS = 5  # shown in a notebook


@dataclass(frozen=True, repr=False)
class ValidationResult:
    """Result of comparing one session with one model: its tables and traces, and what is said of them.

    Every table is an attribute, too: ``result.scores`` is ``result.tables["scores"]``. Tables, columns and units:
    ``docs/results.md``.

    Attributes
    ----------
    session_name, action_name : str
    verdict_lines : list of str
        What was compared, how many trials, RMSE against repeatability, worst channel, events that disagree.
    provenance : dict
        Hashes, versions, tolerance and rules.
    warnings : list of str
        What a reader must know before using the numbers.
    window : Window
        The evaluation window of every score.
    tables : dict of DataFrame
        By name; the modules of `validation.tables` say what each holds.
    spread : DataFrame
        On the common time base inside the window: time_s, then <channel>_mean_rad, _s_r_rad, _band95_rad (half width of
        the simultaneous 95 % band of the mean), _difference_rad (mean paired difference), its _difference_u95_rad
        (1.96 u at each instant, of all declared uncertainties and the scatter of the trials).
    traces : dict of DataFrame
        Trial → time_s, raw_force_n, force_time_s, force_n, u_force_n, <channel>_measured_rad, key_marked,
        <body>_predicted_rad, <channel>_null_rad (null model), <channel>_raw_rad (driven by the raw force),
        <channel>_rad_per_s and <channel>_u_rad_per_s (measured speed, split at contacts, `validation.scores.traces`).
    film_traces : dict of DataFrame
        Trial → time_s, <channel>_measured_rad, <channel>_u_rad, <channel>_predicted_rad.
    motion_trace : DataFrame or None
        Force predicted from the key's motion over time, see `validation.prediction.motion_driven.motion_driven`.
    judgement : dict
        The simultaneous test of the quantities: whether it was made or why not, rejected, p, factor, draws, branch.
    nuisance : DataFrame
        Scores of each trial under drawn errors of force and sensors: trial, channel, draw, rmse_rad,
        before_impact_rmse_rad, iso_overall; the same draws for every model of a session. Empty for one model alone.
    files : dict
        What was written: name → path.
    outcome : str
        One of `OUTCOMES`.
    sentence : str
        The outcome in one sentence, without the names of session and model.
    advice : tuple of str
        What to do, at most three sentences of `validation.pipeline.advice`.
    """

    session_name: str
    action_name: str
    verdict_lines: list[str]
    provenance: dict[str, Any]
    warnings: list[str]
    window: Window
    tables: dict[str, pd.DataFrame]
    spread: pd.DataFrame
    traces: dict[int, pd.DataFrame]
    film_traces: dict[int, pd.DataFrame]
    motion_trace: pd.DataFrame | None
    judgement: dict[str, Any]
    nuisance: pd.DataFrame
    files: dict[str, Path] = field(default_factory=dict)
    outcome: str = CANNOT_TELL
    sentence: str = ""
    advice: tuple[str, ...] = ()

    def __getattr__(self, name: str) -> pd.DataFrame:
        try:
            return self.__dict__["tables"][name]  # type: ignore[no-any-return]
        except KeyError:
            if "tables" not in self.__dict__ or name.startswith("__"):  # while it is being copied or unpickled
                raise AttributeError(name) from None
            near = get_close_matches(name, dir(self), n=1, cutoff=0.7)  # choice: one letter in four wrong
            hint = f"; did you mean {near[0]}?" if near else f"; tables are {', '.join(self.tables)}"
            raise AttributeError(f"ValidationResult has no attribute or table {name!r}{hint}") from None

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *self.tables]

    def with_tables(self, **changed: pd.DataFrame) -> ValidationResult:
        """Copy in which these tables replace those of the same name."""
        return replace(self, tables={**self.tables, **changed})

    def __repr__(self) -> str:
        n = len(self.traces)
        return (
            f"<ValidationResult: model {self.action_name} on {self.session_name}, {n} trial{'' if n == 1 else 's'}>\n"
            f"{textwrap.fill(self.sentence or self.outcome, WIDTH)}"
        )

    def _repr_html_(self) -> str:
        """HTML for a notebook: the sentence, the other lines of the verdict, and the first warnings."""
        text = html.escape
        sentence = f"{text(self.action_name)} on {text(self.session_name)}: {text(self.sentence)}"
        lines = "".join(f"<li>{text(line)}</li>" for line in self.verdict_lines[1:])
        warnings = "".join(f"<li>{text(warning)}</li>" for warning in self.warnings[:MOST_WARNINGS])
        if len(self.warnings) > MOST_WARNINGS:
            warnings += f"<li>and {len(self.warnings) - MOST_WARNINGS} more in <code>result.warnings</code></li>"
        lists = (f"<ul>{lines}</ul>" if lines else "") + (f"<p>Warnings:</p><ul>{warnings}</ul>" if warnings else "")
        return f"<div><p><strong>{sentence}</strong></p>{lists}</div>"

    @property
    def outside(self) -> frozenset[int]:
        """Trials that lie outside of what an identified set was fitted to."""
        return frozenset(int(t) for t in self.trials["trial"][self.trials["outside"].eq(True)])

    @property
    def verdict(self) -> str:
        """The verdict as one paragraph."""
        return " ".join(self.verdict_lines)

    @property
    def base_s(self) -> Array:
        """The one time base of `curves` and ``spread``, (n,) s."""
        return np.asarray(self.spread["time_s"].to_numpy(), dtype=float)

    def to_frame(self, table: str = "curves", trials: Iterable[int] | None = None) -> pd.DataFrame:
        """Return measured and predicted curves of all channels on one time base, or another table.

        Parameters
        ----------
        table : ``curves`` or a name in ``tables``, such as ``quantities``, ``scores``, ``events``
        trials : only these trials

        Returns
        -------
        DataFrame
            Of the curves trial, channel, time_s, measured_rad, predicted_rad, null_rad, u_rad, left_out, force_n; see
            `validation.curves.table.curve_table`. ``attrs["units"]`` has the unit of each column.

        Raises
        ------
        ValidationInputError
            No such table, or a trial that was not compared.

        Examples
        --------
        >>> hammer = result.to_frame().query("channel == 'hammer'")  # doctest: +SKIP
        """
        chosen = None if trials is None else [self._require_compared(trial) for trial in trials]
        if table == "curves":
            frame = curve_table(self.base_s, self.traces, self.film_traces, chosen)
        elif table in self.tables:
            frame = self.tables[table].copy()
            if chosen is not None and "trial" in frame:
                frame = frame[frame["trial"].isin(chosen)]
        else:
            raise ValidationInputError(f"table {table!r}: allowed curves, {', '.join(self.tables)}")
        frame.attrs["units"] = {str(name): unit_of(str(name)) for name in frame}
        return frame

    def curves(self, trials: Iterable[int] | None = None) -> pd.DataFrame:
        """The former name of `to_frame`, for one release."""
        warnings.warn("curves() is to_frame() now", DeprecationWarning, stacklevel=2)
        return self.to_frame(trials=trials)

    def write_curves(self, path: str | Path) -> Path:
        """The former name of `save`, for one release."""
        warnings.warn("write_curves() is save() now", DeprecationWarning, stacklevel=2)
        return self.save(path)

    def curves_netcdf(self) -> bytes:
        """Curves as the bytes of a netCDF-4 file."""
        about = {"session": self.session_name, "model": self.action_name, "verdict": self.sentence}
        return curves_netcdf(self.base_s, self.traces, self.film_traces, about)

    def save(self, path: str | Path) -> Path:
        """Write the curves to ``.nc`` (netCDF-4), ``.csv``, or ``.parquet`` (extra ``parquet``); return the path.

        `validation.write_report` writes the report with all tables.

        Raises
        ------
        ValidationInputError
            Another ending, a folder that cannot be written, or Parquet without pyarrow.
        """
        file = Path(path)
        netcdf = self.curves_netcdf() if file.suffix == ".nc" else b""
        return write_curves(pd.DataFrame() if netcdf else self.to_frame(), netcdf, file)

    def marks(self, trial: int) -> list[Mark]:
        """Moments of a trial: the thesis's positions A, B and C, and its events, in the order of time."""
        frame, events = self.traces[self._require_compared(trial)], self.events
        inside = frame[self.window.mask(frame["time_s"].to_numpy())]
        return trial_marks(inside, events[(events["trial"] == trial) & (events["source"] == "trial")])

    def plot(self, channel: str = "hammer", trial: int | None = None, ax: Axes | None = None) -> Axes:
        """Draw one channel of one trial (default: the first; of jack and repetition the first filmed) with its
        prediction and the marks A, B, C; in a new figure also the difference. Return the axes of trial and model.

        Parameters
        ----------
        channel : {"key", "whippen", "jack", "repetition", "hammer", "force"}
        trial : default: the first, of jack and repetition lever the first that was filmed
        ax : axes for trial and model; by default those of a new figure, with the difference below

        Returns
        -------
        matplotlib.axes.Axes
            Those of trial and model; ``result.plot().figure.savefig("hammer.pdf")`` writes the figure.

        Raises
        ------
        ValidationInputError
            No such channel, a trial that was not compared, or one that was not filmed.
        """
        # start-up: matplotlib costs 0.3 s and a comparison draws nothing
        from validation.curves.plot import new_panels, plot_rotation

        if channel not in (*BODIES, "force"):
            raise ValidationInputError(f"channel {channel!r}: allowed {', '.join((*BODIES, 'force'))}")
        filmed = channel in FILM_CHANNELS
        known = list(self.film_traces if filmed else self.traces)
        if trial is None and known:
            trial = known[0]
        if trial is None or (filmed and trial not in known):
            raise ValidationInputError(f"{channel}: trial {trial} was not filmed; filmed: {known or 'none'}")
        column = f"{channel}_difference_u95_rad"
        reach = self.spread[column].to_numpy(dtype=float) if column in self.spread else None
        panels = new_panels(channel != "force") if ax is None else (ax, None)
        plot_rotation(
            panels,
            self.base_s,
            channel,
            self.traces[self._require_compared(trial)],
            self.film_traces.get(trial),
            band_rad=reach if reach is not None and np.isfinite(reach).any() else None,
            marks=self.marks(trial),
            title=f"trial {trial} of {self.session_name} and {self.action_name}"
            + (", outside of what was fitted" if trial in self.outside else ""),
        )
        return panels[0]

    def _require_compared(self, trial: int) -> int:
        if trial not in self.traces:
            raise ValidationInputError(f"trial {trial}: not compared; allowed {', '.join(map(str, self.traces))}")
        return trial

    def with_files(self, files: dict[str, Path]) -> ValidationResult:
        """A copy that names the files it was written to."""
        return replace(self, files=files)
