"""A bench without driver, device or clock: samples follow the motor's command, or are handed in; faults by script.

For tests of the recorder, of passive recording, recovery and plans. What DAQmx does is tested on the virtual device.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rig import Backend, Block, Capabilities, RigConfig, Timing

RATE_HZ = 5000.0
FORCE_PER_VOLT_N = 12.0
RAD_PER_VOLT = np.array([-0.05, 0.02, 0.3])
"""Key, whippen, hammer; they differ, so that a swap cannot pass unseen."""
REST_FORCE_N = 0.05
MV_PER_V_PER_N = 2.0 / 111.2
SERIAL_NUMBER = "01AB"
INPUTS = ("force", "encoder_key", "encoder_whippen", "encoder_hammer")

Samples = Callable[[int, int], Block]
"""The block of n samples from sample number ``first`` on."""


class PlannedFault(NamedTuple):
    """What one step of the contract raises, once, in a trial; a read when it passes ``at_s``."""

    step: str
    error: BaseException
    trial: int
    at_s: float


class FakeBackend(Backend):
    """The contract of :mod:`rig.backend` in memory.

    Force at sample k is 0.05 N and 12 N/V of the command at sample k - 1, angles are :data:`RAD_PER_VOLT` times that;
    further channels read the command itself.
    ``calls`` are the steps that were asked for; ``commands`` the commands loaded, one a trial.

    Parameters
    ----------
    samples : callable, optional
        Hands out the blocks in place of the command.
    noise_n : float
        Standard deviation of the force, the same for the same seed and trial.
    hardware : bool
        Whether the bench says that something moves.
    speed : float
        Samples come no faster than so many times their own rate.
    """

    def __init__(
        self,
        samples: Samples | None = None,
        *,
        noise_n: float = 0.0,
        seed: int = 7,
        hardware: bool = False,
        speed: float = np.inf,
    ) -> None:
        self._samples, self._noise_n, self._seed, self._hardware = samples, noise_n, seed, hardware
        self._sample_s = 1.0 / (RATE_HZ * speed)
        self._planned: list[PlannedFault] = []
        self._config: RigConfig | None = None
        self.calls: list[str] = []
        self.commands: list[NDArray[np.float64]] = []
        self.waited_s: list[float] = []
        self.trial, self.next_sample = 0, 0
        self.motor_v, self.enabled = 0.0, False

    def plan_fault(self, step: str, error: BaseException, *, trial: int = 1, at_s: float = 0.0) -> None:
        """Let a step (``configure``, ``arm``, ``start``, ``read``, ``stop``) fail."""
        self._planned.append(PlannedFault(step, error, trial, at_s))

    def _take_step(self, step: str, until_s: float = np.inf) -> None:
        for fault in self._planned:
            if fault.step == step and fault.trial == max(self.trial, 1) and fault.at_s < until_s:
                self._planned.remove(fault)
                self.safe_stop()
                raise fault.error

    @property
    def is_safe(self) -> bool:
        """Whether the motor is at 0 V and the drive disabled."""
        return self.motor_v == 0.0 and not self.enabled

    @property
    def capabilities(self) -> Capabilities:
        description = {"serial_number": SERIAL_NUMBER, "client": "fake 1.0"}
        return Capabilities("fake bench", True, description, hardware=self._hardware)

    def configure(self, config: RigConfig, command_v: ArrayLike | None) -> Timing:
        self.calls.append("configure")
        self.trial, self.next_sample, self._config = self.trial + 1, 0, config
        self._noise = np.random.default_rng([self._seed, self.trial])  # in order: the same however blocks are divided
        self.motor_v, self.enabled = 0.0, False
        self._take_step("configure")
        self.commands.append(np.zeros(1) if command_v is None else np.array(command_v, dtype=np.float64))
        if config.camera is None:
            return Timing(RATE_HZ, 0.0)
        return Timing(RATE_HZ, 0.0, config.camera.frame_rate_hz, config.camera.start_delay_s)

    def arm(self, *, enable_drive: bool = True) -> None:
        self.calls.append(f"arm {enable_drive}")
        self._take_step("arm")
        self.enabled = enable_drive

    def start(self) -> None:
        self.calls.append("start")
        self._take_step("start")

    def read_block(self, n_samples: int, timeout_s: float) -> Block:
        self._take_step("read", (self.next_sample + n_samples) / RATE_HZ)
        first = self.next_sample
        self.next_sample += n_samples
        time.sleep(n_samples * self._sample_s)
        block = self._follow_command(first, n_samples) if self._samples is None else self._samples(first, n_samples)
        return self.change_block(block)

    def change_block(self, block: Block) -> Block:
        """Return what is read in place of a block; the block itself unless a test says otherwise."""
        return block

    def _follow_command(self, first: int, n: int) -> Block:
        assert self._config is not None
        command = np.concatenate(([0.0], self.commands[-1]))  # sample k is felt by sample k + 1
        k = np.minimum(np.arange(first, first + n), command.size - 1)
        self.motor_v = float(command[min(first + n, command.size - 1)])
        force_n = REST_FORCE_N + FORCE_PER_VOLT_N * command[k] + self._noise_n * self._noise.standard_normal(n)
        rad_per_count = np.array([encoder.rad_per_count for encoder in self._config.encoders])
        count = np.rint(command[k][:, None] * RAD_PER_VOLT / rad_per_count).astype(np.int64)
        further = np.repeat(command[k][:, None], len(self._config.channels), axis=1) if self._config.channels else None
        return Block(first, force_n, force_n * MV_PER_V_PER_N, count, channel_values=further)

    def safe_stop(self) -> None:
        self.motor_v, self.enabled = 0.0, False
        if self.calls[-1:] != ["safe"]:
            self.calls.append("safe")
        self._take_step("stop")

    def close(self) -> None:
        self.safe_stop()

    def read_positions(self) -> dict[str, tuple[int, int]]:
        return dict.fromkeys(INPUTS, (self.next_sample, self.next_sample))

    def wait(self, duration_s: float) -> None:
        self.waited_s.append(duration_s)

    def continue_after(self, trial: int) -> None:
        self.trial = trial
