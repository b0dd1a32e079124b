"""Results alike: from the columns of a record a pandas table with units, a plot and a file.

A class gives its columns; `Tabular` makes the rest of them. The text is the same in ``model``, ``vision`` and ``rig``,
which import nothing of each other.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from vision.errors import VisionInputError
from vision.files import whole_file

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from numpy.typing import NDArray

UNITS = (
    ("_rad_per_s2", "rad/s^2"), ("_rad_per_s", "rad/s"), ("_m_per_s2", "m/s^2"), ("_m_per_s", "m/s"),
    ("_rad", "rad"), ("_nm", "N m"), ("_px", "px"), ("_hz", "Hz"), ("_m", "m"), ("_n", "N"), ("_j", "J"),
    ("_s", "s"), ("_v", "V"), ("_a", "A"), ("_c", "C"),
)  # fmt: skip
"""By the ending of a column's name; a longer ending stands before a shorter one that it ends with."""
BODY_COLORS = {
    "key": "#8C6D46", "whippen": "#2A8FC4", "jack": "#D55E00", "repetition": "#009E73", "hammer": "#A8528A",
}  # fmt: skip
"""One colour for each body in every picture; told apart with either kind of red-green blindness."""
ENDINGS = (".csv", ".h5", ".parquet")
MOST_NAMES = 12  # in a message


def unit_of(name: str) -> str:
    """SI unit that the end of a column's name states; "1" where it states none."""
    return next((unit for ending, unit in UNITS if name.endswith(ending)), "1")


def axes_or_new(ax: Axes | None) -> Axes:
    """The axes themselves, or those of a new figure."""
    if ax is not None:
        return ax
    import matplotlib.pyplot as plt  # start-up: 0.3 s, only a plot needs it

    return plt.subplots(layout="constrained")[1]


def save_frame(frame: pd.DataFrame, path: str | Path) -> Path:
    """Write a table as ``.csv``, ``.h5`` or ``.parquet`` by the ending of ``path``, replacing a file that is there,
    whole or not at all; return the path. Units, by column in ``frame.attrs["units"]``, are left out of CSV."""
    target = Path(path)
    if target.suffix not in ENDINGS:
        raise VisionInputError(f"{target}: ending found {target.suffix!r}, allowed {', '.join(ENDINGS)}")
    with whole_file(target, VisionInputError, "choose another file") as part:
        if target.suffix == ".csv":
            frame.to_csv(part, index=False, lineterminator="\n")
        elif target.suffix == ".parquet":
            try:
                frame.to_parquet(part, index=False)
            except ImportError:
                advice = "pip install 'piano-action-rig[parquet]'"
                raise VisionInputError(f"{target}: Parquet needs pyarrow; {advice}") from None
        else:
            write_h5(part, {name: frame[name].to_numpy() for name in frame}, frame.attrs.get("units", {}))
    return target


def write_h5(
    path: Path,
    columns: Mapping[str, NDArray[Any]],
    units: Mapping[str, str] = MappingProxyType({}),
    attributes: Mapping[str, Any] = MappingProxyType({}),
    long_names: Mapping[str, str] = MappingProxyType({}),
) -> None:
    """Write columns (n,), numbers or text, as an HDF5 file that xarray opens; ``units`` and ``long_names`` by column (a
    unit not given follows from the name's ending), ``attributes`` of the file; ``time_s`` becomes the scale of the
    rows."""
    import h5py  # start-up: 0.1 s, only such a file needs it

    with h5py.File(path, "w") as file:
        file.attrs.update(attributes)
        for name, values in columns.items():
            kind = h5py.string_dtype() if values.dtype.kind in "OU" else None
            data = file.create_dataset(name, data=values.astype(str).astype(object) if kind else values, dtype=kind)
            data.attrs["units"] = units.get(name, unit_of(name))
            if name in long_names:
                data.attrs["long_name"] = long_names[name]
            if name == "time_s":
                data.make_scale("time_s")
            elif "time_s" in columns:
                data.dims[0].attach_scale(file["time_s"])


class Tabular:
    """A result of equally long columns: a table, a plot, a file, and ``result["hammer"]`` for one of them."""

    _told, _line = "", "-"  # what stands behind a label in a legend, and how lines are drawn: predictions are dashed

    def columns(self) -> dict[str, NDArray[Any]]:
        """Columns (m,) by name, each ending in its unit; ``<body>_rad`` is the angle of a body."""
        raise NotImplementedError

    def __getitem__(self, name: str) -> Any:
        columns = self.columns()
        for known in (name, f"{name}_rad", f"{name}_n", f"{name}_m"):
            if known in columns:
                return columns[known]
        there = ", ".join([*columns][:MOST_NAMES]) + (", …" if len(columns) > MOST_NAMES else "")
        raise VisionInputError(f"{type(self).__name__}: no column {name!r}; there are {there}")

    def to_frame(self) -> pd.DataFrame:
        """Return the columns as a pandas table; ``attrs["units"]`` has the unit of each."""
        import pandas as pd  # start-up: 0.5 s, only a table needs it

        frame = pd.DataFrame(self.columns())
        frame.attrs["units"] = {name: unit_of(name) for name in frame}
        return frame

    def to_table(self) -> pd.DataFrame:
        """The former name of `to_frame`, for one release."""
        warnings.warn("to_table() is to_frame() now", DeprecationWarning, stacklevel=2)
        return self.to_frame()

    def plot(self, *names: str, ax: Axes | None = None, **style: Any) -> Axes:
        """Draw columns over ``time_s`` into ``ax``, or a new figure, and return the axes; bodies' angles are drawn in
        degrees since the first row; without names all bodies; ``style``: what matplotlib's plot takes.

        Parameters
        ----------
        names : bodies or columns; by default all bodies. Angles are drawn in degrees, as the turn since the first row,
            so that a recording and a prediction lie on each other
        ax : matplotlib axes
        style : what matplotlib's ``plot`` takes, such as ``linestyle``
        """
        import numpy as np  # start-up: 0.1 s, only a plot needs it
        from matplotlib import cbook, lines  # start-up: 0.3 s, only a plot needs it

        columns, drawn = self.columns(), axes_or_new(ax)
        time_s = np.asarray(columns["time_s"])
        for name in names or self._names_to_plot():
            values, unit = np.asarray(self[name], dtype=float), unit_of(name)
            if name in columns and unit not in ("1", "rad"):
                label = f"{name}, {unit}"
            else:
                known = values[np.isfinite(values)]
                values, unit, label = np.degrees(values - known[0]) if known.size else values, "°", name
                drawn.set_ylabel("turn since the first row, °")
            own = {"color": BODY_COLORS.get(name.split("_")[0]), "label": label + self._told, "linestyle": self._line}
            drawn.plot(time_s, values, **{**own, **cbook.normalize_kwargs(style, lines.Line2D)})
        drawn.set_xlabel("time, s")
        return drawn

    def _names_to_plot(self) -> list[str]:
        """Bodies that turn, each as it is seen from its parent where that was tracked."""
        columns, bodies = self.columns(), getattr(self, "bodies", BODY_COLORS)
        names = [f"{body}_relative" if f"{body}_relative_rad" in columns else body for body in bodies]
        return [name for name in names if f"{name}_rad" in columns]

    def save(self, path: str | Path) -> Path:
        """Write the table to ``.csv``, ``.h5`` (with units) or ``.parquet``, whole or not at all; return the path."""
        return save_frame(self.to_frame(), path)
