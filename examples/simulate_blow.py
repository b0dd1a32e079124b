"""Simulate one forte blow and evaluate the hammer: using `model` as a library.

Run:  python examples/simulate_blow.py
"""

import numpy as np

import model

action = model.load_action("hirschkorn2004", overrides={"contact04.friction.A": 0.4})
print("rest:", np.round(np.degrees(model.rest_state(action).angle_rad), 3), "degrees")

time_s = np.arange(0, 0.7, 2e-4)
force_n = np.interp(time_s, [0, 0.05, 0.08, 0.11, 0.113, 0.116, 0.3, 0.4, 1], [0, 0, 3, 10, 30, 10, 10, 0, 0])
blow = model.simulate(action, time_s, force_n, tolerance=1e-5, contact_forces=True)

height_mm = 1e3 * blow.hammer_height_m
strike = int(np.argmax(height_mm <= 0))
string_n = blow.contacts["hammer - string"].normal_n
print(f"the hammer strikes at {time_s[strike]:.4f} s; string force up to {string_n.max():.0f} N")
print(f"held in check at {np.median(height_mm[(time_s > 0.2) & (time_s < 0.3)]):.1f} mm below the string")
print(blow.to_frame().iloc[strike - 1 : strike + 2, :6].to_string(index=False))
print("work:", blow.counters)
