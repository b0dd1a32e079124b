"""What the recorder asks of a data-acquisition backend, and how one is found by the scheme of its address.

Contract of a backend, in the order of a trial:

1. ``configure(config, command_v)`` reserves every channel of the rig file, loads the motor command (volts,
   one per sample, the last 0 V; None: no motor task, the drive stays disabled) and returns what the device
   really does (rates after coercion, delays). Before anything else the motor is put at 0 V and the drive
   disabled. Nothing moves.
2. ``arm()`` starts all slave tasks, so that they wait for the trigger, and enables the drive last.
3. ``start()`` starts the master: force, counters, motor command and frame pulses begin on the same edge,
   sample 0.
4. ``read_block(n, timeout_s)`` returns exactly the next n samples of every channel, in order, without a gap,
   or raises.
5. ``safe_stop()`` may be called at any time, any number of times, and leaves the motor at 0 V and the drive
   disabled whatever fails on the way; the next ``configure`` starts afresh.
6. ``close()`` calls ``safe_stop`` and gives everything back.
7. Every failure is a :class:`rig.errors.HardwareFault` with code and phase; no type of a vendor's library
   leaves the backend.
8. Force is calibrated but not corrected; counts are integers since arming; the motor's command is zero-order
   hold.
9. ``read_positions()`` tells by input task how many samples per channel the driver has handed out and acquired
   since ``start``; what is stored is compared with it after each trial. Default: empty, nothing is compared.
10. ``wait(duration_s)`` returns when that much of the bench's time has passed, between two trials. Default:
    :func:`time.sleep`.
11. ``continue_after(trial)`` is called once, before the first new trial of a resumed session. Default: nothing.

:class:`Backend` holds the defaults of 9 to 11: a backend derives from it, or defines all of its members.
:func:`check_contract` refuses any other.

Backends register an opener ``(url, config) -> Backend`` under the entry point group ``pianorig.backends``,
named by URL scheme.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import entry_points
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rig.arrays import ArrayRecord
from rig.configuration.rig_file import RigConfig
from rig.errors import RigInputError

GROUP = "pianorig.backends"
CALM_BLOCK_S = 0.1  # of a block while nothing is commanded and nobody plays: nothing has to react
CALL_TIMEOUT_S = 5.0  # a read or write that takes longer has failed: a block lasts at most 50 ms


@dataclass(frozen=True)
class Capabilities:
    """What a backend is and can do.

    ``simulated`` goes into the session file. ``description`` is what a report shows (driver, product,
    versions). ``hardware`` is True when something outside this program moves, so that permission is needed.
    """

    name: str
    simulated: bool
    description: dict[str, str]
    watchdog: bool = False
    hardware: bool = False


@dataclass(frozen=True)
class Timing:
    """What the device really does: rates after coercion, s and Hz; camera fields are None without a camera.

    ``first_pulse_s`` is the rising edge of the first frame pulse after the start trigger. ``shortest_block_s`` is the
    shortest block the connection keeps up with; 0 where ``recording.block_s`` will do. ``calm_block_s`` is the longest
    block worth reading while the motor's command is 0 V; 0 where blocks cost so little that it may be as any other.
    """

    sample_rate_hz: float
    force_group_delay_s: float
    frame_rate_hz: float | None = None
    first_pulse_s: float | None = None
    shortest_block_s: float = 0.0
    calm_block_s: float = 0.0
    force_device_scaling: tuple[float, ...] = ()
    """Polynomial from the converter's code to the force reading, V or V/V, lowest power first; empty if unknown."""


@dataclass(frozen=True, eq=False)
class Block(ArrayRecord):
    """Successive samples: ``force_n`` (n,), ``force_raw`` (n,) in mV/V or V, ``encoder_count`` (n, 3).

    ``exposure_count`` (n,) is there when a free-running camera's exposures are counted, ``channel_values``
    (n, channels) when the rig file has further channels, each in its unit.
    """

    first_sample: int
    force_n: NDArray[np.float64]
    force_raw: NDArray[np.float64]
    encoder_count: NDArray[np.int64]
    exposure_count: NDArray[np.int64] | None = None
    channel_values: NDArray[np.float64] | None = None


@dataclass(frozen=True, eq=False)
class Expiry:
    """What was read while a watchdog was left to expire.

    ``blocks`` were read; in number ``tripped`` of them, counted from 0, it had expired (None: never). ``locked``: the
    device has ended every task with it, so that nothing shows what its outputs did.
    """

    blocks: list[Block]
    tripped: int | None
    locked: bool = False


class Backend(Protocol):
    """A data-acquisition backend; the numbered contract is in the module's docstring."""

    @property
    def capabilities(self) -> Capabilities:
        """What this backend is and can do."""

    def configure(self, config: RigConfig, command_v: ArrayLike | None) -> Timing:
        """Reserve all channels and load the motor command, if there is one; nothing moves."""

    def arm(self, *, enable_drive: bool = True) -> None:
        """Start the slave tasks, then enable the drive, unless it is to stay disabled."""

    def start(self) -> None:
        """Start the master: everything begins on one trigger."""

    def read_block(self, n_samples: int, timeout_s: float) -> Block:
        """Return the next ``n_samples`` samples of every channel."""

    def safe_stop(self) -> None:
        """Stop, put the motor at 0 V and the drive to disabled; never raises half way."""

    def close(self) -> None:
        """Stop safely and release everything."""

    def read_positions(self) -> dict[str, tuple[int, int]]:
        """Return by input task the samples per channel handed out and acquired since the start; default: none known."""
        return {}

    def wait(self, duration_s: float) -> None:
        """Return when ``duration_s`` of the bench's time has passed; default: the computer's time."""
        time.sleep(duration_s)

    def continue_after(self, trial: int) -> None:
        """Prepare for the trials after ``trial``, the last of a session that is resumed; default: nothing to do."""
        return


Opener = Callable[[str, RigConfig], Backend]


def check_contract(backend: object, contract: type = Backend) -> None:
    declared = {name for base in contract.__mro__ for name in vars(base) if not name.startswith("_")}
    if missing := sorted(name for name in declared if not hasattr(backend, name)):
        raise RigInputError(
            f"backend {type(backend).__qualname__}: lacks {', '.join(missing)}; derive it from rig.backend.Backend"
        )


def open_backend(url: str, config: RigConfig) -> Backend:
    """Open the installed backend that the scheme of an address names, e.g. ``sim://``, ``ni://local`` or
    ``ni-grpc://host:31763``, for the bench ``config``; the caller closes it. RigInputError for an unknown scheme,
    HardwareFault where nothing answers.

    Parameters
    ----------
    url : str
        Its scheme chooses the backend.
    config : RigConfig
        The bench.

    Returns
    -------
    Backend
        To be closed by the caller.

    Raises
    ------
    RigInputError
        When the address has no scheme, no installed backend answers to it, or that lacks a member of the contract.
    HardwareFault
        When the driver, server or device does not answer.

    Examples
    --------
    >>> import rig
    >>> bench = rig.open_backend("sim://", rig.load_rig("virtual").config)
    >>> bench.capabilities.simulated
    True
    >>> bench.close()
    """
    scheme, separator, _ = url.partition("://")
    found = {entry.name: entry for entry in entry_points(group=GROUP)}
    if not separator or scheme not in found:
        known = ", ".join(f"{name}://" for name in sorted(found)) or ("none (install the package: pip install -e .)")
        raise RigInputError(f"backend address {url!r}: no backend for it; installed are {known}")
    opener: Opener = found[scheme].load()
    backend = opener(url, config)
    check_contract(backend)
    return backend
