"""Values and property numbers of NI-DAQmx that several modules of the virtual device use.

Numbers and names are those of ``NIDAQmx.h`` (``DAQmx_Val_…`` and ``DAQmx_…``) without the prefix. Values that only one
module needs are defined there.
"""

from __future__ import annotations

FINITE, CONTINUOUS = 10178, 10123
"""Sample modes."""
RISING, FALLING = 10280, 10171
DIGITAL_EDGE, NO_TRIGGER = 10150, 10230
"""Trigger types."""
ALLOW_REGENERATION, DO_NOT_ALLOW_REGENERATION = 10097, 10158
LOW, HIGH = 10214, 10192
TRISTATE, NO_CHANGE = 10310, 10160
VOLTAGE = 10322
"""Measurement and output type."""
VOLTS, SECONDS, HERTZ, TICKS = 10348, 10364, 10373, 10304
DEGREES, RADIANS = 10146, 10273
FROM_CUSTOM_SCALE = 10065
X1, X2, X4 = 10090, 10091, 10092
"""Decoding types of quadrature encoders."""
NEWTONS, POUNDS, KILOGRAM_FORCE = 15875, 15876, 15877
VOLTS_PER_VOLT, MILLIVOLTS_PER_VOLT = 15896, 15897

AI_BRIDGE_SHUNT_CAL_ENABLE = 0x94
CI_ENCODER_A_INPUT_TERM, CI_ENCODER_B_INPUT_TERM, CI_ENCODER_Z_INPUT_TERM = 0x219D, 0x219E, 0x219F
CO_PULSE_TERM = 0x18E1
DO_TRISTATE = 0x18F3
CO_PULSE_FREQ, CO_PULSE_FREQ_INITIAL_DELAY, CO_PULSE_DUTY_CYC = 0x1178, 0x299, 0x1176
BUF_INPUT_BUF_SIZE, BUF_OUTPUT_BUF_SIZE = 0x186C, 0x186D
WRITE_REGEN_MODE = 0x1453
START_TRIG_RETRIGGERABLE = 0x190F
ARM_START_TRIG_TYPE, DIG_EDGE_ARM_START_TRIG_SRC = 0x1414, 0x1417

EDGES, FREQUENCY, PERIOD, WIDTH = "edges", "frequency", "period", "width"
PULSE_FREQUENCY, PULSE_TIME, PULSE_TICKS = "pulse frequency", "pulse time", "pulse ticks"
"""What a counter measures; the setting ``measures`` of its channel."""
PULSE_PAIRS = (PULSE_FREQUENCY, PULSE_TIME, PULSE_TICKS)
"""Measurements that give two values a sample."""
CI_TERM = {
    EDGES: 0x18C7, FREQUENCY: 0x18A2, PERIOD: 0x18A4, WIDTH: 0x18AA, PULSE_FREQUENCY: 0x2F04, PULSE_TIME: 0x2F0C,
    PULSE_TICKS: 0x2F14,
}  # fmt: skip
"""Property that names the input terminal of each measurement."""
