"""Quantisation tables of JPEG pictures."""

from __future__ import annotations

import struct

import cv2
import numpy as np

from vision.film.source import Compression, jpeg_quantisation_table


def test_steps_of_damaged_jpeg_are_none() -> None:
    assert jpeg_quantisation_table(b"") is None
    assert jpeg_quantisation_table(b"\xff\xd8\xff\xdb\x00") is None
    assert jpeg_quantisation_table(b"\xff\xd8\xff\xdb\x00\x43\x00" + bytes(30)) is None
    steps = jpeg_quantisation_table(b"\xff\xd8\xff\xdb\x00\x43\x00" + bytes(range(1, 65)))
    assert steps is not None
    # the first of the zigzag: right, then down-left, as figure A.6 draws it
    assert (steps[0, 0], steps[0, 1], steps[1, 0], steps[2, 0], steps[1, 1], steps[0, 2]) == (1, 2, 3, 4, 5, 6)
    assert steps[7, 7] == 64
    assert Compression(None).steps is None


def test_steps_are_those_of_the_picture_not_of_its_thumbnail() -> None:
    grey = np.arange(64 * 48, dtype=np.uint8).reshape(48, 64)
    whole, small = (cv2.imencode(".jpg", grey, [cv2.IMWRITE_JPEG_QUALITY, q])[1].tobytes() for q in (95, 30))
    exif = b"\xff\xe1" + struct.pack(">H", 8 + len(small)) + b"Exif\0\0" + small
    steps = jpeg_quantisation_table(whole[:2] + exif + whole[2:])
    np.testing.assert_array_equal(steps, jpeg_quantisation_table(whole))
    assert steps[0, 0] == 2.0  # T.81 table K.1 scaled by libjpeg
