"""The loading experiment of one contact: force over displacement, pressed and released once.

First step of the calibration (thesis Section 2.2.3, Fig. 2.5): a CSV file with the columns ``displacement_m`` and
``force_n``, rows in the order they were measured; displacement is zero at first touch and grows inwards, force is
positive when the felt is pressed. An optional column ``phase`` (``loading`` or ``unloading``) gives the direction;
without it the phases meet at the largest displacement. An error common to all points (compliance of the fixture, zero
of the displacement, gain of the load cell) is a pair of optional columns ``common_<name>_m`` and ``common_<name>_n``:
by how much each point would move if that error were one standard uncertainty.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.arrays import ArrayRecord, as_numbers
from model.errors import InputError
from model.files.csv_columns import read_columns
from model.files.time_table import two_columns

FEWEST_POINTS = 8  # of each phase: enough for a cubic and a noise estimate
BACKWARDS_SHARE = 0.02  # of the largest displacement: jitter of the encoder that is not a change of direction
PHASES = ("loading", "unloading")

PREFIX = "common_"
COMMON = re.compile(PREFIX + r"(?P<name>[a-z][a-z0-9_]*)_[mn]")

Array = NDArray[np.float64]
CommonErrors = dict[str, Array]
"""By name, (2, n): change of displacement, m, and of force, N, of each point."""


@dataclass(frozen=True)
class LoadingCurve(ArrayRecord):
    """Both phases of a loading experiment, each in the order of growing displacement.

    Attributes
    ----------
    loading_m, loading_n : (m,) displacement, m, and force, N, while pressed
    unloading_m, unloading_n : (k,) the same while released
    common : by name, (2, m + k) change of displacement and force of each point, loading first, if one common error were
        one standard uncertainty
    """

    loading_m: Array
    loading_n: Array
    unloading_m: Array
    unloading_n: Array
    common: CommonErrors = field(default_factory=dict)

    def with_common_error(self, name: str) -> LoadingCurve:
        """The curve as it would be if the common error ``name`` were one standard uncertainty."""
        m = len(self.loading_m)
        x, f = self.common[name]
        return LoadingCurve(
            self.loading_m + x[:m], self.loading_n + f[:m], self.unloading_m + x[m:], self.unloading_n + f[m:]
        )

    @property
    def shared_m(self) -> tuple[float, float]:
        """Smallest and largest displacement that both phases cover."""
        return (
            max(float(self.loading_m[0]), float(self.unloading_m[0]), 0.0),
            min(float(self.loading_m[-1]), float(self.unloading_m[-1])),
        )


def split_phases(
    displacement_m: ArrayLike, force_n: ArrayLike, where: str = "loading curve", common: CommonErrors | None = None
) -> LoadingCurve:
    """Split one press and release, (n,) m and N in the order measured, at its largest displacement; check and sort
    them. ``common``: by name, the change (2, n) of displacement and force by one standard uncertainty of a shared
    error.

    Parameters
    ----------
    displacement_m, force_n : (n,) m and N, in the order measured
    where : what to call the experiment in an error
    common : common errors by name, (2, n) each

    Returns
    -------
    LoadingCurve

    Raises
    ------
    InputError : too few points in a phase, or values that cannot be used

    Examples
    --------
    >>> import numpy as np
    >>> import model
    >>> pressed = np.linspace(0.0, 1e-3, 20)
    >>> there_and_back = np.concatenate([pressed, pressed[::-1]])
    >>> curve = model.calibration.split_phases(there_and_back, 1e4 * there_and_back)
    >>> print(f"{1e3 * curve.shared_m[1]:g} mm")
    1 mm
    """
    x = as_numbers(displacement_m, f"{where}: displacement_m", 1)
    turn = int(np.argmax(x)) if len(x) else 0
    phase = np.where(np.arange(len(x)) <= turn, PHASES[0], PHASES[1])
    return check_curve(x, force_n, phase, where, common)


def check_curve(
    displacement_m: ArrayLike,
    force_n: ArrayLike,
    phase: ArrayLike,
    where: str = "loading curve",
    common: CommonErrors | None = None,
) -> LoadingCurve:
    """Check points (n,), m and N, each of a ``phase`` ('loading' or 'unloading'), and sort each phase by displacement.
    ``common``: by name, the change (2, n) of displacement and force by one standard uncertainty of a shared error."""
    x, f = two_columns(displacement_m, force_n, where)
    words = np.asarray(phase, dtype=str)
    for name, column in (("displacement_m", x), ("force_n", f)):
        bad = ~np.isfinite(column)
        if bad.any():
            row = int(np.argmax(bad))
            raise InputError(f"{where}: row {row + 1}: {name} found {column[row]}, allowed finite numbers")
    parts: list[Array] = []
    orders = []
    for name, sense in zip(PHASES, (1.0, -1.0), strict=True):
        own = words == name
        if own.sum() < FEWEST_POINTS:
            other = PHASES[1 - PHASES.index(name)]
            if own.sum() <= 1:
                raise InputError(
                    f"{where}: found one phase only ({other}), allowed loading and unloading; record the release too"
                )
            raise InputError(
                f"{where}: {name}: found {own.sum()} points, allowed at least {FEWEST_POINTS}; sample more finely"
            )
        _check_direction(sense * x[own], np.flatnonzero(own), name, x, where)
        order = np.argsort(x[own], kind="stable")
        parts += [x[own][order], f[own][order]]
        orders.append(np.flatnonzero(own)[order])
    sort = np.concatenate(orders)
    shared = {}
    for name, moved in (common or {}).items():
        each = as_numbers(moved, f"{where}: common error {name}", 2)
        if each.shape != (2, len(x)):
            raise InputError(f"{where}: common error {name}: found shape {each.shape}, allowed (2, {len(x)})")
        shared[name] = each[:, sort]
    curve = LoadingCurve(parts[0], parts[1], parts[2], parts[3], shared)
    low, high = curve.shared_m
    deepest = max(curve.loading_m[-1], curve.unloading_m[-1])
    if high <= low or high - low < 0.5 * deepest:
        raise InputError(
            f"{where}: loading and unloading share displacements from {low:g} to {high:g} m, allowed at least half of "
            f"{deepest:g} m; record both phases over the same range"
        )
    if np.max(curve.loading_n) <= 0.0:
        raise InputError(f"{where}: largest force found {np.max(curve.loading_n):g} N, allowed above 0; check the sign")
    return curve


def _check_direction(along: Array, rows: NDArray[np.int64], name: str, x: Array, where: str) -> None:
    """Raise `InputError` where ``along``, displacements of a phase with the sign that makes them rise, fall by more
    than a share of the range of ``x``, those of both; ``rows``: their indices in the file, ``name``: the phase."""
    back = np.maximum.accumulate(along) - along
    limit = BACKWARDS_SHARE * float(np.ptp(x))
    if (back > limit).any():
        row = int(rows[np.argmax(back > limit)])
        raise InputError(
            f"{where}: row {row + 1}: displacement is not monotone in {name}: found {1e3 * float(back.max()):.3g} mm "
            f"back, allowed {1e3 * limit:.3g} mm; give one press and one release"
        )


def read_curve(path: str | Path) -> LoadingCurve:
    """Read a loading experiment from a CSV file with ``displacement_m,force_n`` and optionally ``phase`` (``loading``
    or ``unloading``); without it, it is split at its largest displacement.

    Parameters
    ----------
    path : CSV file; without ``phase`` the experiment is split at its largest displacement; ``common_…`` as above

    Returns
    -------
    LoadingCurve
        Displacements, m, and forces, N, of both phases.

    Raises
    ------
    InputError : the file cannot be read or used; the message names file and row

    Examples
    --------
    >>> import model
    >>> curve = model.calibration.read_curve("felt.csv")
    >>> print(f"pressed by {1e3 * curve.loading_m[-1]:.1f} mm")
    pressed by 0.5 mm
    """
    table = read_columns(path, ("displacement_m", "force_n"), ("phase",), prefix=PREFIX)
    x, f = table.numbers("displacement_m"), table.numbers("force_n")
    common = {
        name: np.vstack([table.numbers(c) if c in table.names else np.zeros(len(x)) for c in columns])
        for name, columns in find_common_errors(table.names, table.where).items()
    }
    for name, moved in common.items():
        if not np.isfinite(moved).all():
            raise InputError(f"{table.where}: {PREFIX}{name}: found values that are not finite, allowed numbers")
    if "phase" not in table.names:
        return split_phases(x, f, table.where, common)
    phase = table.words("phase")
    for number, word in enumerate(phase, 1):
        if word not in PHASES:
            raise InputError(f"{table.where}: row {number}: phase found {word!r}, allowed {' or '.join(PHASES)}")
    return check_curve(x, f, phase, table.where, common)


def find_common_errors(columns: Sequence[str], where: str) -> dict[str, tuple[str, str]]:
    """Columns ``common_<name>_m`` (displacement) and ``common_<name>_n`` (force) by the ``<name>`` of the shared error;
    `InputError` for another column that begins with ``common_``."""
    found: dict[str, tuple[str, str]] = {}
    for column in columns:
        if column.startswith(PREFIX):
            match = COMMON.fullmatch(column)
            if match is None:
                raise InputError(f"{where}: column found {column}; allowed {PREFIX}<name>_m and {PREFIX}<name>_n")
            found[match["name"]] = (f"{PREFIX}{match['name']}_m", f"{PREFIX}{match['name']}_n")
    return found
