"""``record --felt``: the arm presses a felt or a block; what each press says of the felt's law."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import closing
from pathlib import Path
from typing import Any, Unpack

import numpy as np

from model.calibration import damping_factor, fit_felt, read_curve
from pianorig.errors import CommandInputError
from pianorig.workflows.recording import BenchAccess
from rig import FeltOrder, FeltPress, FeltSession, NotPermitted, load_rig, open_backend, record_felt
from rig.atomic_write import write_text
from rig.felt_recording import BLOCK, checked
from rig.recording.options import RecordingKeywords

SIMULATED = "sim://"
RIG_NAME = "rig_with_compliance.toml"


def press_felt(
    out: Path, order: FeltOrder, access: BenchAccess, **keywords: Unpack[RecordingKeywords]
) -> tuple[FeltSession, dict[str, Any]]:
    """Press a felt, or the block, on a bench; on the virtual one it is mounted by itself.

    Raises
    ------
    rig.RigError : bad rig file, order or path, no permission, a fault; readings that cannot be evaluated
    """
    rig_file = load_rig(access.rig)
    felt = checked(order, rig_file.config, rig_file.source)
    address = access.backend
    if address.startswith(SIMULATED) and "felt=" not in address:
        address += f"{'&' if '?' in address else '?'}felt={order.contact}"
    with closing(open_backend(address, rig_file.config)) as bench:
        if bench.capabilities.hardware:
            what = "a block of steel" if order.contact == BLOCK else f"the felt of {order.contact}"
            question = f"Clamp {what} under the arm, the {felt.encoder}'s scale on the motor's shaft. Press Enter: "
            if access.ask is None or access.ask(question) is None:
                raise NotPermitted(f"{access.backend}: nobody to mount {what}; run it in a terminal")
        on_bench = RecordingKeywords(rig_config=rig_file, backend=bench, permission=access.permission(rig_file, bench))
        done = record_felt(out, order, **(keywords | on_bench))
    if done.compliance is not None:
        write_text(out / RIG_NAME, done.rig_text)
        found = done.compliance
        return done, {
            "compliance_m_per_n": found.m_per_n,
            "u_compliance_m_per_n": found.u_m_per_n,
            "largest_deviation_m": found.crooked_m,
            "rig": out / RIG_NAME,
        }
    rows = [_row(press) for press in done.presses]
    return done, {"presses": rows, **_loop_at_rest(rows)}


def _row(press: FeltPress) -> dict[str, Any]:
    curve, fit = press.curve, fit_felt(read_curve(press.file))
    row: dict[str, Any] = {
        "trial": press.trial,
        "file": press.file,
        "peak_n": curve.peak_n,
        "deepest_m": curve.deepest_m,
        "speed_m_per_s": curve.speed_m_per_s,
        "u_speed_m_per_s": curve.u_speed_m_per_s,
        "abc": fit.abc,
        "u_abc": fit.u_abc,
        "law_fits": fit.law_fits,
    }
    above = fit.loading.force_n(fit.mid_m) - fit.force_n(fit.mid_m)
    if np.max(above) > 0:
        one = damping_factor(fit, curve.speed_m_per_s, curve.u_speed_m_per_s)
        row |= {"D": one.d, "u_D": one.u_d}
    return row


def _loop_at_rest(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """What of the loop does not grow with the speed: eq. 2.7 has none of it."""
    known = [row for row in rows if "D" in row and row["u_D"] > 0]
    speeds = np.array([row["speed_m_per_s"] for row in known])
    if len(known) < 3 or np.ptp(speeds) < 0.5 * speeds.max():
        return {}
    share = np.array([row["D"] for row in known]) * speeds
    u = np.array([row["u_D"] for row in known]) * speeds
    columns = np.column_stack([np.ones(speeds.size), speeds]) / u[:, None]
    covariance = np.linalg.inv(columns.T @ columns)
    rest, slope = covariance @ columns.T @ (share / u)
    left = share / u - columns @ np.array([rest, slope])
    widened = max(float(left @ left) / max(speeds.size - 2, 1), 1.0)
    u_rest, u_slope = np.sqrt(np.diag(covariance) * widened)
    return {"loop": {"at_rest": rest, "u_at_rest": u_rest, "per_speed_s_per_m": slope, "u_per_speed_s_per_m": u_slope}}


def felt_lines(order: FeltOrder, facts: dict[str, Any]) -> list[str]:
    """Lines to print."""
    if order.contact == BLOCK:
        return [
            f"compliance of arm and cell {1e6 * facts['compliance_m_per_n']:.4g} um/N  u "
            f"{1e6 * facts['u_compliance_m_per_n']:.2g}; up to {1e6 * facts['largest_deviation_m']:.2g} um off a line",
            f"{facts['rig']}: the rig file with it",
        ]
    lines = []
    for row in facts["presses"]:
        damping = f"D = {row['D']:.3g}  u {row['u_D']:.2g} s/m" if "D" in row else "no loop"
        lines.append(
            f"trial {row['trial']}: {row['peak_n']:.1f} N, {1e3 * row['deepest_m']:.3f} mm, "
            f"{1e3 * row['speed_m_per_s']:.3g} mm/s, {damping}" + ("" if row["law_fits"] else ", the law does not fit")
        )
    if loop := facts.get("loop"):
        certain = abs(loop["at_rest"]) > 3 * loop["u_at_rest"]
        lines.append(
            f"loop, as a share of the force: {loop['at_rest']:.2g}  u {loop['u_at_rest']:.1g} at no speed, "
            f"{loop['per_speed_s_per_m']:.3g}  u {loop['u_per_speed_s_per_m']:.2g} s/m more with it: "
            + ("eq. 2.7 leaves out what stays at no speed" if certain else "grows with the speed as eq. 2.7 has it")
        )
    last = facts["presses"][-1]
    lines.append(
        f"next: pianorig calibrate felt {last['file'].as_posix()} --contact {order.contact} "
        f"--speed {last['speed_m_per_s']:.4g}+-{last['u_speed_m_per_s']:.1g} --out mine.toml"
    )
    return lines


def felt_order(
    contact: str, speeds: Sequence[float] | None, peaks: Sequence[float] | None, repeats: int | None
) -> FeltOrder:
    """The order of the command line; what is not given is the built-in one."""
    if contact != BLOCK and not (contact.startswith("contact") and contact[7:].isdigit()):
        raise CommandInputError(f"--felt {contact}: allowed contact01 to contact13, or {BLOCK}")
    usual = FeltOrder(contact)
    return FeltOrder(
        contact,
        usual.speeds_m_per_s if speeds is None else speeds,
        usual.peaks_n if peaks is None else peaks,
        1 if repeats is None else repeats,
    )
