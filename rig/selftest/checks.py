"""The steps of the self-test: what each has the bench do, what it must read, and where to look if it does not.

In: an open backend and what the rig file says a sound bench does; out: a finding for each check.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from rig.backend import Block, Timing
from rig.configuration.channels import BODIES
from rig.configuration.rig_file import RigConfig, SelftestConfig
from rig.selftest.backend import SelftestBackend
from rig.selftest.edge import fit_edge, without_hum
from rig.selftest.record import SelftestFinding
from rig.selftest.step_response import LEAD_S, encoder_advice, joined, push_response, push_train

PRESS_S = 4.5
REST_WINDOW_S = 0.3
SETTLED_S = 0.1
"""Force before and after the watchdog trips is the mean over the last of this, however long the blocks are."""
CAMERA_S = 0.5
EDGE_LEAD = 10
"""Samples before the edge of a push that are evaluated with it."""
READ_TIMEOUT_S = 5.0
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
        """Note a finding and tell it; advice is for one that failed."""
        finding = SelftestFinding(
            check=check, passed=passed, found=found, allowed=allowed, advice="" if passed else advice
        )
        self.findings.append(finding)
        self._tell(finding)

    def _acquire(self, command_v: NDArray[np.float64], *, enable_drive: bool) -> tuple[Timing, Block]:
        timing = self.backend.configure(self.config, command_v)
        self.backend.arm(enable_drive=enable_drive)
        self.backend.start()
        size = max(int(round(self.config.recording.block_s * self.rate)), 1)
        blocks = [self.backend.read_block(size, READ_TIMEOUT_S) for _ in range(-(-command_v.size // size))]
        self.backend.safe_stop()
        return timing, joined(blocks)

    def by_hand(self, prompt: Callable[[str], None]) -> None:
        """Unloaded reading, and the encoders' response to a key pressed by the operator."""
        prompt(INSTRUCTION)
        _, block = self._acquire(np.zeros(int(PRESS_S * self.rate)), enable_drive=False)
        turned = (block.encoder_count - block.encoder_count[:1]) * [e.sign for e in self.config.encoders]
        rad = turned * (2 * np.pi / np.array([e.counts_per_revolution for e in self.config.encoders]))
        self._force_by_hand(block)
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

    def _force_by_hand(self, block: Block) -> None:
        n = int(REST_WINDOW_S * self.rate)
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
        least, preload = max(least, 1e-4), abs(resting - self.unloaded_n)
        advice = "lift the arm when asked; it must rest on the key by itself"
        self.add("preload", preload >= least, f"{preload:.4f} N", f"from {least:g} N", advice)
        advice = f"{channel} does not feel the hand: swapped or open analog inputs"
        if self._reversed:
            advice = f"{channel} reads a push as a pull: exchange its signal wires, or the signs of force.physical_n"
        self.add("load cell by hand", self._push_felt, f"{felt:+.3f} N", "above 0.5 N", advice)

    def _push(self, *, enable_drive: bool) -> tuple[NDArray[np.float64], float]:
        """Push gently; return the mean response to one push, N, and its plateau, N."""
        volts = push_train(self.expected.push_n / self.config.motor.force_per_volt_n, self.rate)
        timing, block = self._acquire(volts, enable_drive=enable_drive)
        self._delay_samples = timing.force_group_delay_s * self.rate
        late = int(np.floor(self._delay_samples)) - EDGE_LEAD
        force_n = without_hum(block.force_n, self.rate, self.config.mains_frequency_hz, late)
        return push_response(force_n, self.rate, late)

    def pushed_disabled(self) -> None:
        """With the drive disabled the motor's command must not reach the key."""
        if self.config.drive_enable is None:
            self.add("drive-enable line", False, "none in the rig file", "a line", "add [drive_enable] and wire it")
            return
        _, force = self._push(enable_drive=False)
        self.add("drive disabled", abs(force) < 0.3 * self.expected.push_n, f"{force:+.4f} N",
                 f"below {0.3 * self.expected.push_n:.3g} N", "the motor pushes though its drive-enable is low: "
                 f"{self.config.drive_enable.line} does not reach the drive, or is bridged")  # fmt: skip

    def pushed_enabled(self) -> None:
        """With the drive enabled force must follow the command: sign, size and delay."""
        response, force = self._push(enable_drive=True)
        wanted = self.expected.push_n
        if abs(force) < 0.3 * wanted:
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
        self._add_delay(response if force > 0.3 * wanted else None)

    def _add_delay(self, response: NDArray[np.float64] | None) -> None:
        """The push must begin when it should: after the module's delay and the drive's."""
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

    def watchdog(self) -> None:
        """While the motor pushes the watchdog is not reset: it must cut the force; a chassis shows it after a reset."""
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
        first = joined([self.backend.read_block(size, READ_TIMEOUT_S) for _ in range(int(0.6 * self.rate) // size)])
        lead, settled = int(LEAD_S * self.rate), int(SETTLED_S * self.rate)
        pushed = float(first.force_n[-settled:].mean() - first.force_n[:lead].mean())
        expiry = self.backend.let_watchdog_expire(size, int((timeout + 0.6) * self.rate) // size)
        self.backend.safe_stop()  # a chassis that has expired is reset by it, and everything made afresh
        if expiry.locked:
            last = self._acquire(np.zeros(int(REST_WINDOW_S * self.rate)), enable_drive=False)[1].force_n
        else:
            last = joined(expiry.blocks).force_n[-settled:]
        left = float(last.mean() - first.force_n[:lead].mean())
        after_s = None if expiry.tripped is None else (expiry.tripped + 1) * size / self.rate
        late = after_s is None or not 0.5 * timeout <= after_s <= timeout + 0.25
        self.add("watchdog trips", not late, "never" if after_s is None else f"after {after_s:.3f} s",
                 f"{0.5 * timeout:g} to {timeout + 0.25:g} s", "the device's watchdog does not run")  # fmt: skip
        cut = pushed > 0.3 * self.expected.push_n and abs(left) < 0.3 * self.expected.push_n
        advice = "the watchdog's line does not reach the drive's enable input"
        if pushed <= 0.3 * self.expected.push_n:
            advice = "no force was there to cut: mend what is said under motor and force first"
        self.add(
            "watchdog cuts the force",
            cut,
            f"{pushed:+.3f} N before, {left:+.3f} N after" + (" the chassis was reset" if expiry.locked else ""),
            "force, then none",
            advice,
        )

    def shunt(self) -> None:
        """The bridge's reading must change by what its shunt resistor predicts."""
        force, shunt = self.config.force, self.expected.shunt_ohm
        if force.kind != "bridge" or shunt == 0:
            return
        wanted = 1e3 * force.bridge_resistance_ohm / (4 * shunt + 2 * force.bridge_resistance_ohm)
        found = self.backend.shunt_step(self.config)
        tolerance = self.expected.shunt_tolerance
        self.add("bridge shunt", abs(found - wanted) <= tolerance * wanted, f"{found:+.4f} mV/V",
                 f"{wanted:+.4f} mV/V ± {tolerance:.0%}", f"no bridge on {force.channel}, or its wiring, excitation or "
                 "bridge_resistance_ohm are wrong; look for swapped analog inputs")  # fmt: skip

    def loopback(self) -> None:
        """An input wired to the motor's output reads each sample one edge after it was put out."""
        if self.expected.loopback is None:
            return
        volts = 0.5 * np.sin(np.linspace(0, 40 * np.pi, int(0.4 * self.rate))) * np.hanning(int(0.4 * self.rate))
        volts[0] = volts[-1] = 0.0
        read = self.backend.loopback_read(self.config, self.expected.loopback, volts)
        errors = [float(np.abs(read[lag:] - volts[: volts.size - lag]).max()) for lag in range(6)]
        lag = int(np.argmin(errors))
        self.add("output to input", lag == 1 and errors[lag] < 0.02, f"{lag} samples, {errors[lag]:.4f} V off",
                 "1 sample, below 0.02 V",
                 f"{self.expected.loopback} is not wired to {self.config.motor.channel}")  # fmt: skip

    def camera(self) -> None:
        """Edges on the camera's terminal in half a second, counted by a counter of its own."""
        camera = self.config.camera
        if camera is None:
            return
        pulses = camera.mode == "pulses"
        counter = self.config.encoders[0].counter if pulses else camera.counter
        found = self.backend.count_edges(self.config, counter, camera.terminal, CAMERA_S, pulses)
        wanted = (CAMERA_S - 1 / self.rate - (camera.start_delay_s if pulses else 0.0)) * camera.frame_rate_hz
        self.add("camera count", abs(found - wanted) <= 2 + 1e-3 * wanted, f"{found} edges", f"{wanted:.0f} ± 2",
                 f"look at {camera.terminal}, the camera's rate and its trigger setting")  # fmt: skip
