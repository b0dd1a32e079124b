"""What every trial file says of its own origin, so that it stands alone: who, what, which devices and programs."""

from __future__ import annotations

import contextlib
import functools
import platform
from importlib.metadata import PackageNotFoundError, version

from rig.backend import Capabilities
from rig.configuration.profile import Profile
from rig.configuration.rig_file import RigConfig
from rig.session.info import SessionInfo

PACKAGES = ("piano-action-rig", "numpy", "h5py", "nidaqmx", "grpcio")


def software_versions() -> dict[str, str]:
    return {"python": platform.python_version(), "system": platform.platform(), **_package_versions()}


@functools.cache  # they are read from files, 20 ms with every trial otherwise; a running program's do not change
def _package_versions() -> dict[str, str]:
    versions = {}
    for package in PACKAGES:
        with contextlib.suppress(PackageNotFoundError):
            versions[package] = version(package)
    return versions


def trial_provenance(
    info: SessionInfo, capabilities: Capabilities, config: RigConfig, profile: Profile | None
) -> dict[str, str]:
    """Return the origin of a trial that begins now, by name; what is not known is ``unknown`` or left out.

    Devices come with serial numbers where the driver gives them, software as it runs now: a session may be resumed
    with other versions than it began with.
    """
    force = config.force.certificate
    calibrated = {"force": force, **{f"encoder_{e.name}": e.certificate for e in config.encoders}}
    calibrated |= {channel.name: channel.certificate for channel in config.channels}
    return {
        "session": info.name,
        "operator": info.operator,
        "action": info.action.name,
        "action_key": info.action.key,
        "rig": info.rig.name,
        "rig_sha256": info.rig.sha256,
        **({} if profile is None else {"profile": profile.name, "profile_sha256": profile.sha256}),
        "device": config.device.name,
        "backend": capabilities.name,
        **{f"backend_{key}": value for key, value in capabilities.description.items()},
        **{f"calibration_date_{name}": c.date for name, c in calibrated.items() if c is not None},
        **{f"software_{package}": found for package, found in software_versions().items()},
    }
