"""Fingerprints of a trial's samples, by which it is known again in another file, session, cut or start time.

A channel is read in windows of `WINDOW` samples; of their rolling hashes those that are multiples of `ONE_IN` are kept
(winnowing; Manber 1994, USENIX Winter Technical Conference). Two recordings that share a stretch share its
fingerprints, wherever it lies in either of them. Encoders are taken by the steps of their counts, so that the first
count does not matter; windows in which a count hardly changes are left out, and so are those in which a reading is
near its first value: before the blow a virtual bench of one seed reads alike in every session.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator

import numpy as np
from numpy.typing import NDArray

from rig.session import TrialData

WINDOW = 64  # samples of a fingerprint: choice, so long a run is no chance
ONE_IN = WINDOW  # kept of them, for size: choice, some hundred of a record
FEWEST_SHARED = 2  # one may be the same by chance: values of 48 bits, some hundred a record
SHARE_OF_ONE_STROKE = 0.5  # of the fingerprints of the shorter record: beyond it most of one lies in the other
MOVED_SHARE = 0.05  # of a reading's range: mains hum and noise of a quiet baseline stay below
DIGITS = 12  # hexadecimal, of a fingerprint as written
BASE = np.uint64(0x9E3779B97F4A7C15)  # odd, so that no power of it vanishes modulo 2^64


def sample_fingerprints(data: TrialData) -> tuple[str, ...]:
    found = {f"{value:016x}"[:DIGITS] for channel in _channels(data) for value in _hashes(*channel)}
    return tuple(sorted(found))


def are_same_samples(one: Collection[str], other: Collection[str]) -> bool:
    return len(set(one) & set(other)) >= FEWEST_SHARED


def are_same_stroke(one: Collection[str], other: Collection[str]) -> bool:
    shared = len(set(one) & set(other))
    return shared >= FEWEST_SHARED and shared > SHARE_OF_ONE_STROKE * min(len(one), len(other))


def _channels(data: TrialData) -> Iterator[tuple[NDArray[np.uint64], NDArray[np.bool_]]]:
    """Yield for each channel its count steps or readings (n,) as 64-bit integers, and a mask of those that change."""
    for counts in np.asarray(data.encoder_count, dtype=np.int64).T:
        steps = np.diff(counts)
        yield steps.astype(np.uint64), np.abs(steps) > 1
    readings = [data.force_raw] if data.has_force else []
    if data.channel_values is not None:
        readings += list(np.asarray(data.channel_values, dtype=float).T)
    for reading in readings if data.n_valid else []:
        values = np.ascontiguousarray(reading, dtype=np.float64)
        away = np.abs(values - np.median(values[:WINDOW])) > MOVED_SHARE * np.ptp(values)
        yield values.view(np.uint64), away & np.concatenate([[False], np.diff(values) != 0.0])


def _hashes(samples: NDArray[np.uint64], is_changing: NDArray[np.bool_]) -> list[int]:
    """Hashes, 64 bits, of about one in 64 of the windows of 64 ``samples`` (n,), chosen by their content, so that equal
    stretches share them; windows in which fewer than three quarters of ``is_changing`` (n,) hold are skipped."""
    n = samples.size - WINDOW + 1
    if n < 1:
        return []
    total = np.zeros(n, dtype=np.uint64)
    with np.errstate(over="ignore"):
        for k in range(WINDOW):
            total = total * BASE + samples[k : k + n]
        # the mixing of SplitMix64 (Steele, Lea and Flood 2014)
        mixed = (total ^ (total >> np.uint64(29))) * np.uint64(0xBF58476D1CE4E5B9)
        mixed ^= mixed >> np.uint64(32)  # a part of it
    telling = np.convolve(is_changing, np.ones(WINDOW, dtype=int), "valid") >= 3 * WINDOW // 4
    return [int(value) for value in mixed[telling & (mixed % np.uint64(ONE_IN) == 0)]]
