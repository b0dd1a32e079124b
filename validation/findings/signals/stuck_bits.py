"""Counter bits that are stuck: the counts never take half of the values that a moving encoder must pass.

Conventions: counts since rest modulo twice the bit's weight, in sixteen sectors. A turning encoder fills all of them;
with a stuck bit, and whatever the first count, half stay empty. Looked for are bits whose weight the travel passes
four times or more, with 200 different counts; a stuck lowest bit is half the resolution and not detectable.
"""

from __future__ import annotations

import numpy as np

from validation.conventions import ENCODER_CHANNELS
from validation.findings.finding import SessionFinding
from validation.measurement.trial import MeasuredTrial

SECTORS = 16
FILLED = 10  # sectors, at most, with a stuck bit
FEWEST_COUNTS = 200
LOWEST = 6  # below, a sector is so narrow that wrong decoding leaves it empty
PASSES = 4


def stuck_bits(m: MeasuredTrial) -> list[SessionFinding]:
    """Bits of each encoder's counter that never change."""
    out = []
    for i, name in enumerate(ENCODER_CHANNELS):
        change = m.change_rad[:, i]
        counts = np.unique(np.rint((change - change[0]) / m.resolution_rad[i]).astype(np.int64))
        extent = int(np.ptp(counts)) if counts.size else 0
        bit = LOWEST
        while counts.size >= FEWEST_COUNTS and PASSES * 2 ** (bit + 1) <= extent:
            sector = np.unique(counts % 2 ** (bit + 1) // (2 ** (bit + 1) // SECTORS))
            if sector.size <= FILLED:
                text = (
                    f"trial {m.number}: encoder {name}: of the values of the counter's bit {bit} only half occur: the "
                    f"bit is "
                    f"stuck, an error of up to {2**bit} counts; check cable and counter"
                )
                out.append(SessionFinding("stuck bit", m.number, name, float(bit), float(FILLED), text))
                break
            bit += 1
    return out
