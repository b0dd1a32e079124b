"""Motor drives planted in the virtual bench and identified from its log: error over uncertainty of each number.

Each case draws resistance, inductance, torque constant, gains and arm, in torque or voltage mode, with the current
recorded or a gain known instead; half meet the limit of current, a sixth that of the supply as well. Sensors err as
those of the virtual bench: noise of the load cell, counts of the encoder, scales off by 0.5 %.
"""

from __future__ import annotations

import tempfile
from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import model
from benchmarks.runner import Run, Table
from rig.simulated.backend import DEFAULT_BENCH
from rig.simulated.bench.plant import load_plant

MOTOR = "[motor]\ntorque_per_volt_nm = 1.2     # 120 N at 10 V and 100 mm, thesis 3.1.1\n"
ARM = "inertia = 2.2e-4             # kg m^2"
COUNT_RAD = 2.0 * np.pi / 327680
NOISE_N, NOISE_A, SCALE = 0.02, 0.02, 5e-3
LARGEST_RMS = 1.5  # of error over u


@dataclass(frozen=True)
class Planted:
    """A drive as it is, its log, and what is known of it beside the log."""

    mode: str
    truth: dict[str, float]
    log: model.drive.DriveLog
    known: dict[str, tuple[float, float]]


def draw(seed: int) -> Planted:
    """One drive and its log from the virtual bench."""
    random = np.random.default_rng(seed)
    mode, current = ("torque", "voltage")[seed % 2], seed % 4 < 2
    met = {0: "current", 2: "both", 3: "current"}  # of six; in voltage mode the supply stays far
    limits = met.get(seed % 6, "")
    drive = {
        "resistance": random.uniform(0.6, 2.0), "inductance": random.uniform(1e-3, 5e-3),
        "torque_constant": random.uniform(0.3, 0.9), "supply": 160.0, "current_limit": 30.0,
        "current_gain": random.uniform(1.0, 3.0), "loop_gain": random.uniform(10.0, 30.0), "voltage_gain": 0.0,
    }  # fmt: skip
    if mode == "voltage":
        drive |= {"current_gain": 0.0, "loop_gain": 0.0, "voltage_gain": random.uniform(1.0, 4.0)}
    if limits:
        drive["current_limit"] = random.uniform(2.0, 2.8) / drive["torque_constant"]
    if limits == "both":
        drive["supply"] = random.uniform(20.0, 40.0)
    inertia = random.uniform(1.5e-4, 3.0e-4)
    text = DEFAULT_BENCH.read_text("utf-8")
    assert MOTOR in text and ARM in text
    text = text.replace(MOTOR, "").replace(ARM, f"inertia = {inertia!r}")
    text += "\n[motor_drive]\n" + "".join(f"{name} = {value!r}\n" for name, value in drive.items())
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "bench.toml"
        path.write_text(text, "utf-8")
        plant = load_plant(path, seed=seed, sample_rate_hz=5000.0)
    plant.scatter.clear()
    plant.start_trial(1)
    command = model.drive.identification_command(plant.action, plant.choice, seed, 40.0 if limits else 22.0)
    block = plant.advance(command)
    truth = plant.truth()
    scales = 1.0 + SCALE * random.standard_normal(2)
    noise = random.standard_normal((2, len(command)))
    amperes = truth.speed_rad_per_s[:, truth.coordinates.index("winding")]
    log = model.drive.DriveLog(
        block.time_s,
        command,
        scales[0] * block.force_n + NOISE_N * noise[0],
        COUNT_RAD * np.round(block.motor_rad / COUNT_RAD),
        scales[1] * amperes + NOISE_A * noise[1] if current else None,
    )
    gain = "current_gain" if mode == "torque" else "voltage_gain"
    stated = drive[gain] * (1.0 + 0.01 * random.standard_normal())
    whole = drive["resistance"] + drive["loop_gain"]
    k = drive["torque_constant"]
    combinations = {
        "resistance_and_loop_gain": whole, "delay": drive["inductance"] / whole, "damping": k * k / whole,
        "torque_per_volt": k * drive[gain] / (1.0 if mode == "torque" else whole),
        "ceiling": k * drive["current_limit"], "inertia": inertia,
    }  # fmt: skip
    return Planted(mode, drive | combinations, log, {} if current else {gain: (stated, 0.01 * stated)})


def errors(planted: Planted) -> dict[str, tuple[float, float]]:
    """Error over uncertainty, and relative uncertainty, of what the log determines."""
    found = model.drive.identify_drive(planted.log, model.drive.DriveOptions(planted.mode, known=planted.known))
    wanted = (e for e in (*found.drive, *found.combinations, found["inertia"]) if e.determined)
    return {e.name: ((e.value - planted.truth[e.name]) / e.u, e.u / e.value) for e in wanted}


def main(run: Run) -> bool:
    """Print the table; whether errors are as large as stated."""
    all_found: dict[str, list[tuple[float, float]]] = defaultdict(list)
    for seed in range(run.seed, run.seed + run.drives):
        for name, pair in errors(draw(seed)).items():
            all_found[name].append(pair)
    table = Table("number:26s", "determined:d", "of:d", "rms e/u:.2f", "worst:.2f", "within u %:.0f", "median u %:.1f")
    for name, pairs in all_found.items():
        z, relative = np.array(pairs).T
        rms, worst, inside = np.sqrt(np.mean(z**2)), np.abs(z).max(), np.mean(np.abs(z) <= 1.0)
        table.row(name, len(z), run.drives, rms, worst, 100 * inside, 100 * np.median(relative))
    z = np.array([error for pairs in all_found.values() for error, _ in pairs])
    return bool(np.sqrt(np.mean(z**2)) < LARGEST_RMS)
