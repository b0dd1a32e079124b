"""Draw the README figure from a demo session.

Run:  pianorig demo --out demo_session && python docs/make_pictures.py demo_session
"""

from __future__ import annotations

import sys
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

import validation
import vision
from vision.output.colours import body_colour

BLUE, ORANGE = "#0072B2", "#D55E00"  # measured and predicted, as in a report


def main(folder: str) -> None:
    """Draw docs/images/demo.png from the session in ``folder``."""
    result = validation.compare(folder)
    trace, film = result.traces[1], result.film_traces[1]
    session = Path(folder)
    figure, axes = plt.subplots(1, 3, figsize=(11, 3.4), width_ratios=[1.1, 1, 1], layout="constrained")
    with vision.open_film(session / "trial_0001.mraw") as source:
        axes[0].imshow(source.read(130), cmap="gray")
    for k, body in enumerate(vision.load_bodies(session / "bodies.toml")):
        outline = np.vstack([body.polygon_px, body.polygon_px[:1]])
        axes[0].plot(*outline.T, color=body_colour(body.name, k), linewidth=1.2, label=body.name)
    axes[0].set_title("film: outlines at rest over frame 130", fontsize=9)
    axes[0].legend(fontsize=7, loc="upper left")
    axes[0].set(xlim=(0, source.width), ylim=(source.height, 0))
    axes[0].set_axis_off()
    shown = (trace["time_s"] > 0.38) & (trace["time_s"] < 0.95)
    axes[1].plot(trace["time_s"][shown], -np.degrees(trace["hammer_measured_rad"][shown]), color=BLUE, label="measured")
    predicted = np.degrees(trace["hammer_predicted_rad"][shown])
    axes[1].plot(trace["time_s"][shown], -predicted, color=ORANGE, dashes=(4, 2), label="predicted")
    axes[1].set_title("hammer, θ_h(0) − θ_h", fontsize=9)
    axes[2].plot(film["time_s"], -np.degrees(film["jack_measured_rad"]), color=BLUE, label="tracked")
    jack = np.degrees(film["jack_predicted_rad"])
    axes[2].plot(film["time_s"], -jack, color=ORANGE, dashes=(4, 2), label="predicted")
    axes[2].set_xlim(0.38, 0.95)
    axes[2].set_title("jack, θ_j(0) − θ_j", fontsize=9)
    for ax in axes[1:]:
        ax.set_xlabel("time (s)")
        ax.set_ylabel("angle (°)")
        ax.legend(fontsize=8)
        ax.grid(alpha=0.3)
    figure.savefig(Path(__file__).parent / "images" / "demo.png", dpi=110)


if __name__ == "__main__":
    main(sys.argv[1])
