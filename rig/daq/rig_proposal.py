"""A rig file proposed for a device that was found: the built-in one of its product, with the names found."""

from __future__ import annotations

import re
from collections.abc import Sequence

from rig.configuration.rig_file import load_rig
from rig.daq.discovery import FoundDevice
from rig.errors import RigInputError

PATTERNS = {"cDAQ-9189": "virtual", "PCIe-6363": "pcie6363"}
"""Built-in rig file of each product."""
MODULES = {"Mod1": ("NI 9237", "load cell"), "Mod2": ("NI 9263", "motor"), "Mod3": ("NI 9411", "encoders"),
           "Mod4": ("NI 9401", "drive enable and camera")}  # fmt: skip
"""Modules of the pattern for a chassis: product, what it is for."""


def propose_rig(found: Sequence[FoundDevice], name: str | None = None) -> str:
    """Return the text of a rig file for one of the devices found: ``name``, or the first of a product that has a
    built-in pattern; refuse where there is none or a module is missing. Nothing is written."""
    usable = [device for device in found if device.product in PATTERNS and name in (None, device.name)]
    if not usable:
        there = ", ".join(f"{device.name} ({device.product})" for device in found) or "none"
        wanted = " or ".join(PATTERNS) + (f" named {name}" if name else "")
        raise RigInputError(f"devices found: {there}; a rig file can be proposed for a {wanted}")
    device = usable[0]
    pattern = load_rig(PATTERNS[device.product])
    body = pattern.text[pattern.text.index("schema = ") :]
    own_name = re.sub(r"\W", "_", device.name).lower()
    body = re.sub(r'(?m)^name = "\w+"$', f'name = "{own_name}"', body, count=1)
    renamed = _pair_device_names(device, pattern.config.device.name)
    any_name = "|".join(map(re.escape, renamed))  # all at once: a found name may be another one of the pattern
    return _rig_file_comments(device) + re.sub(rf"\b({any_name})\b", lambda match: renamed[match[0]], body)


def _pair_device_names(device: FoundDevice, pattern_name: str) -> dict[str, str]:
    """Map the pattern's names, whose device is ``pattern_name``, to those found: of a chassis each module of the
    pattern to the first found of its product, then the device; refuse a chassis that lacks a module."""
    renamed = {}
    if device.modules:
        for slot, (product, purpose) in MODULES.items():
            fitting = [module for module in device.modules if module.product == product]
            if not fitting:
                there = ", ".join(f"{module.product} in slot {module.slot}" for module in device.modules)
                raise RigInputError(f"{device.name}: has no {product} ({purpose}); found are {there}")
            renamed[f"{pattern_name}{slot}"] = fitting[0].name
    return {**renamed, pattern_name: device.name}


def _rig_file_comments(device: FoundDevice) -> str:
    """Comment lines at the head of a proposed rig file."""
    lines = [
        f"# Proposed by  pianorig info --propose  for {device.name}, {device.product}, serial number {device.serial}.",
        *(f"#   slot {m.slot}: {m.name}, {m.product}, serial number {m.serial}" for m in device.modules),
        "# Device names are those found. Everything else is the pattern's; look at it before anything moves:",
        "# terminals, scales, counts per revolution, signs, limits, uncertainties, certificates, the arm.",
    ]
    return "\n".join(lines) + "\n"
