"""Record two soft blows on the virtual bench and read them back: using `rig` as a library.

Run:  python examples/record_session.py [FOLDER]
"""

import sys
import tempfile
from pathlib import Path

import numpy as np

import rig

folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(tempfile.mkdtemp()) / "session"
rig.record(folder, profile="piano", trials=2, backend="sim://", operator="example")

for trial in rig.Session.open(folder).trials:
    data = trial.read()
    turn = np.degrees(np.ptp(data.angle_rad, axis=0))
    names = [encoder.name for encoder in data.encoders]
    print(f"trial {trial.number}: {trial.status}, {data.n_valid} samples, peak {data.raw_force_n.max():.2f} N")
    print("   turned by", ", ".join(f"{name} {value:.2f} deg" for name, value in zip(names, turn, strict=True)))
print("session:", folder)
