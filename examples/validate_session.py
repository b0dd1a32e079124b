"""Record three blows and compare two models with them; the results are pandas tables.

Run:  python examples/validate_session.py
"""

import tempfile
from pathlib import Path

import model
import rig
import validation

folder = Path(tempfile.mkdtemp()) / "session"
session = rig.record(folder, profile="forte", trials=3, backend="sim://", operator="example")

printed = validation.compare(session, "hirschkorn2004")
stiffer = validation.compare(session, model.load_action(overrides={"contact04.friction": 0}))
columns = ["channel", "rmse_rad", "s_r_rad"]
print("as printed\n", printed.channels[columns].to_string(index=False))
print("without friction at the back check\n", stiffer.channels[columns].to_string(index=False))
print(printed.event_summary[["event", "trial_mean", "model_mean", "unit"]].to_string(index=False))

result = validation.validate_session(session, "hirschkorn2004")
print("report:", result.files["report.html"])
