"""The self-test of a bench: what is wired where, which way it counts, and whether it really stops.

With the drive disabled the operator lifts the arm and presses the key (unloaded reading, encoder signs, scales, counts
below zero); the motor pushes gently, with the drive disabled, then enabled (drive-enable, polarity and scale of the
motor, delay to the input in samples); the watchdog is not reset while the motor pushes; the bridge's shunt resistor is
switched in; camera edges are counted. A check that fails says where to look; a fault of the hardware becomes the
finding of its step.
"""

from __future__ import annotations

from collections.abc import Callable
from datetime import UTC, datetime

from rig.configuration.rig_file import Rig
from rig.errors import HardwareFault, RigInputError
from rig.selftest.backend import SelftestBackend
from rig.selftest.checks import Checks
from rig.selftest.record import SelftestFinding, SelftestRecord


def run_selftest(
    rig: Rig,
    backend: SelftestBackend,
    *,
    prompt: Callable[[str], None],
    operator: str = "unknown",
    now: datetime | None = None,
    tell: Callable[[SelftestFinding], None] | None = None,
) -> SelftestRecord:
    """Test a bench with gentle pushes.

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
        ("by hand", lambda: checks.by_hand(prompt)),
        ("drive disabled", checks.pushed_disabled),
        ("motor and force", checks.pushed_enabled),
        ("watchdog", checks.watchdog),
        ("bridge shunt", checks.shunt),
        ("output to input", checks.loopback),
        ("camera", checks.camera),
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
        backend=capabilities.name,
        simulated=capabilities.simulated,
        operator=operator,
        unloaded_n=checks.unloaded_n,
        findings=tuple(checks.findings),
    )
