"""The self-test of a bench: what is wired where, which way it counts, and whether it really stops.

When a push begins is found to some hundredths of a sample. The arm rings on load cell and key, so that no level
crossing tells when the torque changed: a crossing comes some 0.3 ms late, by another amount on each bench. Fitted is a
damped oscillation towards a plateau, ``p (1 - exp(-a t) (cos w t + a/w sin w t))``, whose phase gives the beginning;
mains hum is taken off first, as it is the same in every push.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Literal, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import ConfigDict, Field

from rig.atomic_write import translate_os_error, write_text
from rig.backend import CALL_TIMEOUT_S, Backend, Block, Capabilities, Expiry, Timing
from rig.configuration import toml_file
from rig.configuration.rig_file import BODIES, Number, Rig, RigConfig, SelftestConfig, Table, Text
from rig.errors import HardwareFault, NotPermitted, RigInputError
from rig.mains_hum import fit_mains_hum

SCHEMA: Literal["piano-action-rig selftest 1"] = "piano-action-rig selftest 1"


class SelftestFinding(Table):
    """One check: what was found, what is allowed, and what to do if it did not pass."""

    check: Text
    passed: bool = Field(strict=True)
    found: str
    allowed: str
    advice: str = ""


class SelftestRecord(Table):
    """A whole record; ``unloaded_n`` is what the force channel reads with the arm lifted off the key."""

    schema_name: Literal["piano-action-rig selftest 1"] = Field(default=SCHEMA, alias="schema")
    created_utc: datetime
    rig: Text
    rig_sha256: Text
    product: Text
    device: Text
    serial_number: str = ""
    backend: Text
    simulated: bool = Field(strict=True)
    operator: str = "unknown"
    unloaded_n: Number | None = None
    findings: tuple[SelftestFinding, ...]

    model_config = ConfigDict(populate_by_name=True)

    @property
    def passed(self) -> bool:
        """Whether every check passed; a record without checks did not."""
        return bool(self.findings) and all(finding.passed for finding in self.findings)

    @property
    def bench(self) -> str:
        """The device that was tested, as :func:`bench_of` names one."""
        return _bench(self.product, self.serial_number, self.simulated)

    def write(self, folder: Path) -> Path:
        """Write the record as ``<UTC time>_<rig>.toml`` into a folder, which is created if missing; return the file's
        path."""
        stamp = self.created_utc.astimezone(UTC)
        path = folder / f"{stamp:%Y-%m-%dT%H%M%SZ}_{self.rig}.toml"
        with translate_os_error(folder, "created"):
            folder.mkdir(parents=True, exist_ok=True)
        table = self.model_dump(by_alias=True)
        table["created_utc"] = stamp.isoformat(timespec="seconds")
        write_text(path, toml_file.dump_toml(table))
        return path


def _bench(product: str, serial_number: str, simulated: bool) -> str:
    return f"{'simulated ' if simulated else ''}{product}, serial number {serial_number or 'unknown'}"


def bench_of(capabilities: Capabilities) -> str:
    """Name the device behind a backend: product, serial number, and whether it is simulated."""
    description = capabilities.description
    return _bench(description.get("product", ""), description.get("serial_number", ""), capabilities.simulated)


def read_record(path: Path) -> SelftestRecord:
    return toml_file.check(SelftestRecord, toml_file.parse_toml(toml_file.read_text(path), str(path)), str(path))


def valid_record(
    rig: Rig, records_path: Path, now: datetime | None = None, *, address: str = "ADDRESS"
) -> tuple[Path, SelftestRecord]:
    """Return path and content of the newest record of this very rig file in ``records_path``, a file or folder;
    NotPermitted where there is none, it failed, or is older than the rig file allows. ``address``: for the advice only.
    """
    now = now or datetime.now(UTC)
    advice = f"run  pianorig selftest --backend {address} --rig {rig.source}"
    files = (
        [records_path]
        if records_path.is_file()
        else sorted(records_path.glob("*.toml"))
        if records_path.is_dir()
        else []
    )
    records = [(path, read_record(path)) for path in files]
    mine = [(path, record) for path, record in records if record.rig_sha256 == rig.sha256]
    if not mine:
        raise NotPermitted(f"{records_path}: no self-test of rig file {rig.source} as it is; {advice}")
    path, record = max(mine, key=lambda item: _utc(item[1].created_utc))
    failed = [finding.check for finding in record.findings if not finding.passed]
    if not record.passed:
        raise NotPermitted(f"{path}: did not pass ({', '.join(failed) or 'no checks'}); mend it and run it again")
    age = now - _utc(record.created_utc)
    allowed_h = rig.config.safety.selftest_valid_h
    if not timedelta(0) <= age <= timedelta(hours=allowed_h):
        raise NotPermitted(
            f"{path}: self-test of {_utc(record.created_utc):%Y-%m-%d %H:%M} UTC is {age / timedelta(hours=1):.1f} h "
            f"old, allowed 0 to {allowed_h:g} h (safety.selftest_valid_h); {advice}"
        )
    return path, record


def _utc(moment: datetime) -> datetime:
    return moment.astimezone(UTC) if moment.tzinfo else moment.replace(tzinfo=UTC)


class SelftestBackend(Backend, Protocol):
    """A backend with the calls only a self-test makes (:mod:`rig.daq.nidaqmx_backend`)."""

    def shunt_step(self, config: RigConfig) -> float:
        """Return the change of the bridge's reading with its shunt resistor, mV/V."""

    def count_edges(self, config: RigConfig, counter: str, terminal: str, duration_s: float, pulses: bool) -> int:
        """Return the rising edges on a terminal."""

    def read_loopback(self, config: RigConfig, channel: str, command_v: ArrayLike) -> NDArray[np.float64]:
        """Return what an input wired to the motor's output reads, V."""

    def let_watchdog_expire(self, n_samples: int, blocks: int) -> Expiry:
        """Read without resetting the watchdog; the blocks, in which it expired, and whether the device ended it."""


PUSHES = 8  # averaged, so that noise is divided by 2.8
PUSH_S = 0.15  # of a push, and of the pause after it: ringing has died away
LEAD_S = 0.3  # rest before the pushes: 15 periods of 50 Hz, 18 of 60 Hz


def push_train(volts: float, rate_hz: float) -> NDArray[np.float64]:
    """Return the motor command of a row of equal gentle pushes, V, on the sample clock."""
    push = int(PUSH_S * rate_hz)
    one = np.concatenate((np.full(push, volts), np.zeros(push)))
    return np.concatenate((np.zeros(int(LEAD_S * rate_hz)), np.tile(one, PUSHES), np.zeros(push)))


def push_response(force_n: NDArray[np.float64], rate_hz: float, delay: int) -> tuple[NDArray[np.float64], float]:
    """Mean response to the pushes of `push_train`, N above the force before each, counted from ``delay`` samples after
    a push begins, (m,), and its plateau, N."""
    lead, push = int(LEAD_S * rate_hz), int(PUSH_S * rate_hz)
    period = 2 * push
    rows = [force_n[lead + i * period + delay :][:period] for i in range(PUSHES)]
    before = [force_n[lead + i * period - period // 4 : lead + i * period].mean() for i in range(PUSHES)]
    shortest = min(row.size for row in rows)
    response = np.mean([row[:shortest] - zero for row, zero in zip(rows, before, strict=True)], axis=0)
    return response, float(response[push // 3 : push - 2].mean())


UNMOVED_SHARE = 0.02  # of a stroke: below it a body has not moved; every wrong scale named gives more


def encoder_advice(config: RigConfig, body: int, turned_rad: float) -> str:
    """Likely cause of a wrong stroke of ``body`` (0 key, 1 whippen, 2 hammer), turned by ``turned_rad``, as text: does
    not move, wrong sign, cable of another body, wrong scale; empty without ``[selftest]`` in the rig file."""
    if config.selftest is None:
        return ""
    encoders, strokes, tolerance = config.encoders, config.selftest.stroke_rad, config.selftest.stroke_tolerance
    expected = [s / (2 * np.pi) * e.counts_per_revolution for s, e in zip(strokes, encoders, strict=True)]
    counts = turned_rad / (2 * np.pi) * encoders[body].counts_per_revolution

    def is_near(other: float) -> bool:
        return abs(counts - other) <= tolerance * abs(other)

    if abs(counts) < UNMOVED_SHARE * abs(expected[body]):
        return "does not move: look at its plug, supply and terminals"
    if is_near(-expected[body]):
        return "turns the wrong way: change its sign, or exchange A and B"
    for other, theirs in enumerate(expected):
        if other != body and (is_near(theirs) or is_near(-theirs)):
            return f"reads like the {BODIES[other]}: its cable or terminals are swapped with the {BODIES[other]}'s"
    ratio = abs(counts / expected[body])
    if min(abs(ratio / 4 - 1), abs(4 * ratio - 1)) <= tolerance:
        return f"wrong scale by {ratio:.3g}: counts_per_revolution must count all four edges, four for each line"
    return f"wrong scale by {ratio:.3g}: look at counts_per_revolution and the decoding"


def join_blocks(blocks: list[Block]) -> Block:
    return Block(
        blocks[0].first_sample,
        np.concatenate([block.force_n for block in blocks]),
        np.concatenate([block.force_raw for block in blocks]),
        np.concatenate([block.encoder_count for block in blocks]),
    )


FITTED_S = 0.012  # of a push after half its plateau: one period of the slowest ringing
EARLIEST_S, LATEST_S = -2e-3, 15e-3  # of the edge, against when it is due: a delay of 8 ms that was forgotten is seen
RINGING_HZ = (80.0, 2400.0)  # of arm and cell: slower is no ringing, faster is above half the sample rate
STARTS = 6  # frequencies from which the fit begins: a factor 1.6 apart
SHAPE_SAMPLES = 0.1  # standard uncertainty for a bench that rings unlike the fitted curve
Array = NDArray[np.float64]


@dataclass(frozen=True)
class Edge:
    """A fitted edge: how late it is, its standard uncertainty, s, and the frequency at which the arm rings, Hz."""

    late_s: float
    u_s: float
    ringing_hz: float


def subtract_hum(force_n: Array, rate_hz: float, mains_hz: float, delay: int) -> Array:
    """Force (n,), N, during `push_train`, less offset, drift and mains hum, fitted to the samples in which nothing
    pushes; the response comes ``delay`` samples after the command."""
    lead, push = int(LEAD_S * rate_hz), int(PUSH_S * rate_hz)
    quiet = np.zeros(force_n.size, dtype=bool)
    quiet[:lead] = True
    for k in range(PUSHES):
        end = lead + 2 * (k + 1) * push + delay
        quiet[end - push // 2 : end] = True
    t = np.arange(force_n.size) / rate_hz
    fit = fit_mains_hum(t, force_n, quiet, np.array([mains_hz]), np.column_stack([np.ones(t.size), t]))
    return force_n - fit.rest - fit.hum


def fit_edge(response_n: Array, rate_hz: float, at_sample: float) -> Edge | None:
    """Fit when the mean response to a push (m,), N, begins, as a damped oscillation: how late after the sample
    ``at_sample`` it was due at, s, its uncertainty, ringing; None where there is no push."""
    from scipy.optimize import least_squares  # start-up: 0.2 s that only a self-test needs

    t = (np.arange(response_n.size) - at_sample) / rate_hz
    plateau = float(response_n[int(2 * LATEST_S * rate_hz) : int(PUSH_S * rate_hz) - EDGE_LEAD].mean())
    crossed = np.flatnonzero((response_n > 0.5 * plateau) & (t > EARLIEST_S) & (t < LATEST_S))
    if not np.isfinite(response_n).all() or plateau <= 0 or not crossed.size:
        return None
    crossing_s = float(t[crossed[0]])
    n = int(np.searchsorted(t, crossing_s + FITTED_S))
    t = t[:n]

    def curve(p: Array) -> Array:
        late, level, decay, w, rest = p
        after = np.maximum(t - late, 0.0)
        ringing = np.exp(-decay * after) * (np.cos(w * after) + decay / w * np.sin(w * after))
        return np.asarray(rest + level * (1.0 - ringing))

    bounds = (
        [EARLIEST_S, 0.0, 0.0, 2 * np.pi * RINGING_HZ[0], -plateau],
        [LATEST_S, np.inf, np.inf, 2 * np.pi * RINGING_HZ[1], plateau],
    )
    # without damping half the level is reached after a sixth of a period
    starts = [(crossing_s - 1 / (6 * hz), 2 * np.pi * hz) for hz in np.geomspace(*RINGING_HZ, STARTS + 2)[1:-1]]
    fits = [
        least_squares(
            lambda p: curve(p) - response_n[:n],
            [late, plateau, 0.25 * w, w, 0.0],
            bounds=bounds,
            x_scale=[1 / w, plateau, w, w, plateau],
        )
        for late, w in starts
        if EARLIEST_S < late < LATEST_S
    ]
    if not fits:
        return None
    best = min(fits, key=lambda fit: float(fit.cost))
    variance = 2 * best.cost / max(n - best.x.size, 1)
    covariance = np.linalg.pinv(best.jac.T @ best.jac) * variance
    return Edge(
        float(best.x[0]),
        float(np.hypot(np.sqrt(covariance[0, 0]), SHAPE_SAMPLES / rate_hz)),
        float(best.x[3] / (2 * np.pi)),
    )


PRESS_S = 4.5  # for the operator to lift the arm and press the key once
SETTLED_S = 0.1  # of a mean, before and after the watchdog trips: 5 periods of 50 Hz
ABSENT_SHARE = 0.3  # of a push: below it no force is there: choice; a drive that is off leaves noise
CAMERA_S = 0.5  # over which frame pulses are counted: choice: 1 of 1000 at 2000 frames/s
EDGE_LEAD = 10  # samples before the edge of a push that are evaluated with it: choice
TRIP_SLACK_S = 0.25  # that a watchdog may trip late: blocks last at most 50 ms, calls some more
LOOPBACK_V = 0.02  # off the sample put out: choice; an input that is not wired is off by 0.5 V
INSTRUCTION = (
    "drive disabled: lift the arm off the key for a second, put it back, then press the key slowly to its bottom and "
    f"let it come up again, all within {PRESS_S:g} s"
)


class Checks:
    """The steps, and what they found."""

    def __init__(
        self,
        config: RigConfig,
        expected: SelftestConfig,
        backend: SelftestBackend,
        tell: Callable[[SelftestFinding], None],
    ) -> None:
        self.config, self.expected, self.backend, self._tell = config, expected, backend, tell
        self.rate = config.device.sample_rate_hz
        self.findings: list[SelftestFinding] = []
        self.unloaded_n: float | None = None
        self._push_felt = self._reversed = False
        self._delay_samples = 0.0

    def add(self, check: str, passed: bool, found: str, allowed: str, advice: str = "") -> None:
        """Add a finding to ``findings`` and show it; advice is dropped where the check passed."""
        finding = SelftestFinding(
            check=check, passed=passed, found=found, allowed=allowed, advice="" if passed else advice
        )
        self.findings.append(finding)
        self._tell(finding)

    def _acquire(self, command_v: NDArray[np.float64], *, enable_drive: bool) -> tuple[Timing, Block]:
        """Put out a motor command (n,), V, read until it has ended, then stop safely; return the device's timing and
        all samples as one block. ``enable_drive``: whether the motor may push."""
        timing = self.backend.configure(self.config, command_v)
        self.backend.arm(enable_drive=enable_drive)
        self.backend.start()
        size = max(int(round(self.config.recording.block_s * self.rate)), 1)
        blocks = [self.backend.read_block(size, CALL_TIMEOUT_S) for _ in range(-(-command_v.size // size))]
        self.backend.safe_stop()
        return timing, join_blocks(blocks)

    def check_by_hand(self, prompt: Callable[[str], None]) -> None:
        """Show the instruction to lift the arm and press the key (``prompt`` returns when the operator is ready),
        record with the drive disabled, and add the checks of unloaded force, preload, load cell and encoders."""
        prompt(INSTRUCTION)
        _, block = self._acquire(np.zeros(int(PRESS_S * self.rate)), enable_drive=False)
        rad = (block.encoder_count - block.encoder_count[:1]) * [e.rad_per_count for e in self.config.encoders]
        self._check_force_by_hand(block)
        stroke = np.take_along_axis(rad, np.argmax(np.abs(rad), axis=0)[None, :], axis=0)[0]
        for body, name in enumerate(BODIES):
            wanted, tolerance = self.expected.stroke_rad[body], self.expected.stroke_tolerance
            passed = abs(stroke[body] - wanted) <= tolerance * abs(wanted)
            self.add(
                f"{name} encoder",
                bool(passed),
                f"turned {stroke[body]:+.4f} rad",
                f"{wanted:+.4f} rad ± {tolerance:.0%}",
                encoder_advice(self.config, body, float(stroke[body])),
            )
        below = int(block.encoder_count.min())
        wrapped = int(np.abs(block.encoder_count).max()) >= 2**31
        signed = below < 0 and not wrapped
        found = f"smallest {below}, largest {int(block.encoder_count.max())}"
        advice = "ticks must be read as signed numbers; one body turns below 0"
        self.add("counts below zero", signed, found, "some below 0, none beyond 2^31", advice)

    def _check_force_by_hand(self, block: Block) -> None:
        """Add the checks of unloaded reading, preload and load cell (sign), from a block in which the arm was lifted
        and the key pressed by hand; sets ``unloaded_n``."""
        n = int(LEAD_S * self.rate)
        mean = np.convolve(block.force_n, np.full(n, 1 / n), "valid")
        resting = float(np.median(mean[: max(n // 4, 1)]))
        up, down = float(block.force_n.max()) - resting, resting - float(block.force_n.min())
        felt = up if up >= down else -down
        self._push_felt, self._reversed = felt > 0.5, felt < -0.5
        self.unloaded_n = round(float(mean.max() if self._reversed else mean.min()), 5)
        channel = self.config.force.channel
        limit = self.expected.offset_limit_n
        self.add("unloaded reading", abs(self.unloaded_n) <= limit, f"{self.unloaded_n:.4f} N", f"within {limit:g} N",
                 f"null the bridge on {channel}; look at its wiring")  # fmt: skip
        least = self.config.limits.least_preload_n or 0.0
        least, preload = max(least, self.config.force.u_noise_n), abs(resting - self.unloaded_n)
        advice = "lift the arm when asked; it must rest on the key by itself"
        self.add("preload", preload >= least, f"{preload:.4f} N", f"from {least:g} N", advice)
        advice = f"{channel} does not feel the hand: swapped or open analog inputs"
        if self._reversed:
            advice = f"{channel} reads a push as a pull: exchange its signal wires, or the signs of force.physical_n"
        self.add("load cell by hand", self._push_felt, f"{felt:+.3f} N", "above 0.5 N", advice)

    def _push_gently(self, *, enable_drive: bool) -> tuple[NDArray[np.float64], float]:
        """Command several pushes of the rig file's ``push_n``; return the mean response to one, N above the force
        before, (m,), less hum, and its plateau, N. Stores the force channel's delay."""
        volts = push_train(self.expected.push_n / self.config.motor.force_per_volt_n, self.rate)
        timing, block = self._acquire(volts, enable_drive=enable_drive)
        self._delay_samples = timing.force_group_delay_s * self.rate
        late = int(np.floor(self._delay_samples)) - EDGE_LEAD
        force_n = subtract_hum(block.force_n, self.rate, self.config.mains_frequency_hz, late)
        return push_response(force_n, self.rate, late)

    def check_push_disabled(self) -> None:
        """Command gentle pushes with the drive disabled and add the check that no force reaches the key; it fails where
        the rig file has no drive-enable line."""
        if self.config.drive_enable is None:
            self.add("drive-enable line", False, "none in the rig file", "a line", "add [drive_enable] and wire it")
            return
        _, force = self._push_gently(enable_drive=False)
        most = ABSENT_SHARE * self.expected.push_n
        self.add("drive disabled", abs(force) < most, f"{force:+.4f} N", f"below {most:.3g} N",
                 f"the motor pushes though its drive-enable is low: {self.config.drive_enable.line} does not reach "
                 "the drive, or is bridged")  # fmt: skip

    def check_push_enabled(self) -> None:
        """Enable the drive, push the key gently by the motor, and add the checks of the force (sign, size) and of the
        delay from output to force."""
        response, force = self._push_gently(enable_drive=True)
        wanted = self.expected.push_n
        if abs(force) < ABSENT_SHARE * wanted:
            line = self.config.drive_enable.line if self.config.drive_enable else "its drive-enable"
            advice = (
                f"no force: {line} does not enable the drive, or {self.config.motor.channel} is not the motor's input"
            )
            if not self._push_felt:
                advice = f"no force: {self.config.force.channel} is not the load cell; look for swapped analog inputs"
        elif force < 0 and self._reversed:
            advice = "the load cell reads a push as a pull: mend that first, and leave the motor as it is"
        elif force < 0:
            advice = "the motor pulls: exchange its command's polarity"
        else:
            advice = "wrong size: look at motor.force_per_volt_n, the drive's gain and the load cell's scale"
        tolerance = self.expected.push_tolerance
        self.add("motor and force", abs(force - wanted) <= tolerance * wanted, f"{force:+.4f} N",
                 f"{wanted:+.3g} N ± {tolerance:.0%}", advice)  # fmt: skip
        self._add_delay(response if force > ABSENT_SHARE * wanted else None)

    def _add_delay(self, response: NDArray[np.float64] | None) -> None:
        """Add the check that the mean response (m,), N, begins when the delays of module and drive say, within the
        allowed tolerance; None, for no push, fails."""
        delay, limit_s = self._delay_samples, self.expected.latency_tolerance_samples / self.rate
        at = EDGE_LEAD + delay - np.floor(delay) + self.expected.drive_delay_s * self.rate
        edge = None if response is None else fit_edge(response, self.rate, at)
        late_s = float("nan") if edge is None else edge.late_s
        sure = edge is not None and edge.u_s <= limit_s / 2
        found = "no edge" if edge is None else f"{late_s * 1e3:+.3f} ms, u {edge.u_s * 1e3:.3f}, "
        found += "" if edge is None else f"beside {delay / self.rate * 1e3:.3f} ms; rings at {edge.ringing_hz:.0f} Hz"
        advice = "force.module, group_delay_s, selftest.drive_delay_s or the clock's route are wrong"
        if edge is not None and not sure:
            advice = "too uncertain: look for noise on the force, or a loose arm; raise selftest.push_n"
        passed = sure and abs(late_s) <= limit_s
        self.add("output to force delay", passed, found, f"within {limit_s * 1e3:.3g} ms", advice)

    def check_watchdog(self) -> None:
        """Push by the motor, stop resetting the watchdog, and add the checks that it trips in time and cuts the force;
        the check fails where the rig file has no watchdog.

        A chassis whose watchdog has expired is reset before the force is read again.
        """
        config = self.config
        if config.watchdog is None:
            self.add("watchdog", False, "none in the rig file", "a watchdog", "add [watchdog]")
            return
        timeout = config.watchdog.timeout_s
        volts = self.expected.push_n / config.motor.force_per_volt_n
        held = int((2 * timeout + 1.0) * self.rate)
        command = np.concatenate((np.zeros(int(LEAD_S * self.rate)), np.full(held, volts), np.zeros(2)))
        self.backend.configure(config, command)
        self.backend.arm()
        self.backend.start()
        size = max(int(round(config.recording.block_s * self.rate)), 1)
        first = join_blocks(
            [self.backend.read_block(size, CALL_TIMEOUT_S) for _ in range(int(2 * LEAD_S * self.rate) // size)]
        )
        lead, settled = int(LEAD_S * self.rate), int(SETTLED_S * self.rate)
        pushed = float(first.force_n[-settled:].mean() - first.force_n[:lead].mean())
        expiry = self.backend.let_watchdog_expire(size, int((timeout + 2 * TRIP_SLACK_S) * self.rate) // size)
        self.backend.safe_stop()  # a chassis that has expired is reset by it, and everything made afresh
        if expiry.locked:
            last = self._acquire(np.zeros(int(LEAD_S * self.rate)), enable_drive=False)[1].force_n
        else:
            last = join_blocks(expiry.blocks).force_n[-settled:]
        left = float(last.mean() - first.force_n[:lead].mean())
        after_s = None if expiry.tripped is None else (expiry.tripped + 1) * size / self.rate
        low, high = 0.5 * timeout, timeout + TRIP_SLACK_S
        trips = after_s is not None and low <= after_s <= high
        self.add("watchdog trips", trips, "never" if after_s is None else f"after {after_s:.3f} s",
                 f"{low:g} to {high:g} s", "the device's watchdog does not run")  # fmt: skip
        most = ABSENT_SHARE * self.expected.push_n
        cut = pushed > most and abs(left) < most
        advice = "the watchdog's line does not reach the drive's enable input"
        if pushed <= most:
            advice = "no force was there to cut: mend what is said under motor and force first"
        self.add(
            "watchdog cuts the force",
            cut,
            f"{pushed:+.3f} N before, {left:+.3f} N after" + (" the chassis was reset" if expiry.locked else ""),
            "force, then none",
            advice,
        )

    def check_shunt(self) -> None:
        """Switch the bridge's shunt resistor in, and add the check that the reading changes as predicted; nothing where
        the force is no bridge or the rig file states no shunt."""
        force, shunt = self.config.force, self.expected.shunt_ohm
        if force.kind != "bridge" or shunt == 0:
            return
        wanted = 1e3 * force.bridge_resistance_ohm / (4 * shunt + 2 * force.bridge_resistance_ohm)
        found = self.backend.shunt_step(self.config)
        tolerance = self.expected.shunt_tolerance
        self.add("bridge shunt", abs(found - wanted) <= tolerance * wanted, f"{found:+.4f} mV/V",
                 f"{wanted:+.4f} mV/V ± {tolerance:.0%}", f"no bridge on {force.channel}, or its wiring, excitation or "
                 "bridge_resistance_ohm are wrong; look for swapped analog inputs")  # fmt: skip

    def check_loopback(self) -> None:
        """Put out a sine of half a volt, and add the check that the input wired to the motor's output reads each sample
        one later; nothing where the rig file states no such input."""
        if self.expected.loopback is None:
            return
        n = int(LEAD_S * self.rate)
        volts = 0.5 * np.sin(2 * np.pi * self.config.mains_frequency_hz * np.arange(n) / self.rate) * np.hanning(n)
        read = self.backend.read_loopback(self.config, self.expected.loopback, volts)
        errors = [float(np.abs(read[lag:] - volts[: volts.size - lag]).max()) for lag in range(6)]
        lag = int(np.argmin(errors))
        self.add("output to input", lag == 1 and errors[lag] < LOOPBACK_V,
                 f"{lag} samples, {errors[lag]:.4f} V off", f"1 sample, below {LOOPBACK_V:g} V",
                 f"{self.expected.loopback} is not wired to {self.config.motor.channel}")  # fmt: skip

    def check_camera(self) -> None:
        """Count the edges on the camera's terminal for half a second, and add the check of their number; nothing
        without a camera."""
        camera = self.config.camera
        if camera is None:
            return
        pulses = camera.mode == "pulses"
        counter = self.config.encoders[0].counter if pulses else camera.counter
        found = self.backend.count_edges(self.config, counter, camera.terminal, CAMERA_S, pulses)
        wanted = (CAMERA_S - 1 / self.rate - (camera.start_delay_s if pulses else 0.0)) * camera.frame_rate_hz
        self.add("camera count", abs(found - wanted) <= 2 + 1e-3 * wanted, f"{found} edges", f"{wanted:.0f} ± 2",
                 f"look at {camera.terminal}, the camera's rate and its trigger setting")  # fmt: skip


def run_selftest(
    rig: Rig,
    backend: SelftestBackend,
    *,
    prompt: Callable[[str], None],
    operator: str = "unknown",
    now: datetime | None = None,
    tell: Callable[[SelftestFinding], None] | None = None,
) -> SelftestRecord:
    """Test a bench with gentle pushes of its motor: every check by hand and by motor in turn, where a fault of hardware
    counts as a failed check; return the record, which is not written. RigInputError without ``[selftest]`` in the rig
    file.

    Parameters
    ----------
    rig : Rig
    backend : SelftestBackend
    prompt : callable
        Shows an instruction and returns when the operator is ready.
    operator : str
    now : datetime, optional
        For the record; by default the computer's time.
    tell : callable, optional
        Called with each finding at once.

    Returns
    -------
    SelftestRecord

    Raises
    ------
    RigInputError
        When the rig file has no ``[selftest]``.

    Examples
    --------
    >>> import rig
    >>> virtual = rig.load_rig("virtual")
    >>> bench = rig.open_backend("sim://?hand=yes", virtual.config)
    >>> rig.run_selftest(virtual, bench, prompt=lambda instruction: None).passed
    True
    >>> bench.close()
    """
    if rig.config.selftest is None:
        raise RigInputError(f"{rig.source}: has no [selftest]; add it, with stroke_rad, to say what a sound bench does")
    checks = Checks(rig.config, rig.config.selftest, backend, tell or (lambda finding: None))
    steps: tuple[tuple[str, Callable[[], None]], ...] = (
        ("by hand", lambda: checks.check_by_hand(prompt)),
        ("drive disabled", checks.check_push_disabled),
        ("motor and force", checks.check_push_enabled),
        ("watchdog", checks.check_watchdog),
        ("bridge shunt", checks.check_shunt),
        ("output to input", checks.check_loopback),
        ("camera", checks.check_camera),
    )
    for name, step in steps:
        try:
            step()
        except HardwareFault as fault:
            checks.add(name, False, " ".join(str(fault).split()), "no fault", "see the message")
        finally:
            backend.safe_stop()
    capabilities = backend.capabilities
    return SelftestRecord(
        created_utc=now or datetime.now(UTC),
        rig=rig.config.name,
        rig_sha256=rig.sha256,
        product=capabilities.description.get("product", rig.config.device.product),
        device=rig.config.device.name,
        serial_number=capabilities.description.get("serial_number", ""),
        backend=capabilities.name,
        simulated=capabilities.simulated,
        operator=operator,
        unloaded_n=checks.unloaded_n,
        findings=tuple(checks.findings),
    )
