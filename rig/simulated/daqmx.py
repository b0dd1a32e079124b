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
LOW, HIGH = 10214, 10192
TRISTATE, NO_CHANGE = 10310, 10160
VOLTAGE = 10322
"""Measurement and output type."""
VOLTS, HERTZ, TICKS = 10348, 10373, 10304
DEGREES, RADIANS = 10146, 10273
X1, X2, X4 = 10090, 10091, 10092
"""Decoding types of quadrature encoders."""
NEWTONS, POUNDS, KILOGRAM_FORCE = 15875, 15876, 15877
VOLTS_PER_VOLT, MILLIVOLTS_PER_VOLT = 15896, 15897

AI_BRIDGE_SHUNT_CAL_ENABLE = 0x94
CI_COUNT_EDGES_TERM = 0x18C7
CI_ENCODER_A_INPUT_TERM, CI_ENCODER_B_INPUT_TERM = 0x219D, 0x219E
CO_PULSE_TERM = 0x18E1
BUF_OUTPUT_BUF_SIZE = 0x186D
ARM_START_TRIG_TYPE, DIG_EDGE_ARM_START_TRIG_SRC = 0x1414, 0x1417
