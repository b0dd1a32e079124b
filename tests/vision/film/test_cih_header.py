"""Photron headers: what is read is what stands there; what cannot be a film is refused in one line."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vision import FilmError
from vision.film.mraw import FilmHeader, cihx_bytes, read_header

CIH = """#Camera Information Header
Date : 2016/4/21
Camera Type : FASTCAM SA-Z type 2100K-M-64GB
Record Rate(fps) : 60000
Shutter Speed(s) : 1/800000
Original Total Frame : 677
Total Frame : 12
Start Frame : 49300
Save Step : 36
Image Width : 896
Image Height : 368
Color Type : Mono
Color Bit : 16
File Format : MRaw
EffectiveBit Depth : 12
EffectiveBit Side : Higher
Comment Text : first: test
Shutter Type2(nsec) : 1250

#Photron Fastcam Viewer Version Information (Resave):
Image Width : 7
"""

headers = st.builds(
    FilmHeader,
    width=st.integers(1, 4096),
    height=st.integers(1, 4096),
    n_frames=st.integers(1, 10**7),
    colour_bit=st.sampled_from([8, 12, 16]),
    effective_bit=st.integers(1, 8),
    bit_side=st.sampled_from(["lower", "higher"]),
    frame_rate_hz=st.one_of(st.none(), st.integers(1, 2_100_000).map(float)),
    exposure_s=st.one_of(st.none(), st.integers(1, 10**9).map(lambda ns: ns * 1e-9)),
    start_frame=st.integers(-(10**9), 10**9),
    frame_step=st.integers(1, 1000),
    recorded_frames=st.integers(1, 10**9),
    comment=st.text(st.characters(min_codepoint=33, max_codepoint=0x2FF), max_size=20).map(str.strip),
)


@given(headers)
def test_cihx_round_trip(tmp_path_factory: pytest.TempPathFactory, header: FilmHeader) -> None:
    path = tmp_path_factory.mktemp("cihx") / "film.cihx"
    path.write_bytes(cihx_bytes(header))
    found = read_header(path)
    if header.exposure_s is None:
        assert found.exposure_s is None
    else:
        assert found.exposure_s == pytest.approx(header.exposure_s, rel=1e-12)
    assert found == FilmHeader(**{**header.__dict__, "exposure_s": found.exposure_s})


def test_cih_text(tmp_path: Path) -> None:
    path = tmp_path / "film.cih"
    path.write_bytes(CIH.replace("\n", "\r\n").encode())
    header = read_header(path)
    assert (header.width, header.height, header.n_frames) == (896, 368, 12)
    assert (header.colour_bit, header.effective_bit, header.bit_side) == (16, 12, "higher")
    assert (header.start_frame, header.frame_step, header.recorded_frames) == (49300, 36, 677)
    assert header.frame_rate_hz == 60000.0
    assert header.exposure_s == pytest.approx(1.25e-6)
    assert header.comment == "first: test"


def test_shutter_as_fraction(tmp_path: Path) -> None:
    path = tmp_path / "film.cih"
    path.write_text(CIH.replace("Shutter Type2(nsec) : 1250\n", ""))
    assert read_header(path).exposure_s == pytest.approx(1 / 800000)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("Image Width : 896\n", "", "Image Width"),
        ("Image Height : 368", "Image Height : -368", "-368"),
        ("Total Frame : 12\n", "Total Frame : 0\n", "Total Frame"),
        ("Color Bit : 16", "Color Bit : 24", "24 bit"),
        ("Color Type : Mono", "Color Type : Color", "'Color'"),
        ("EffectiveBit Side : Higher", "EffectiveBit Side : Upper", "'upper'"),
        ("File Format : MRaw", "File Format : Avi", "'Avi'"),
        ("Record Rate(fps) : 60000", "Record Rate(fps) : nan", "'nan'"),
        ("Save Step : 36", "Save Step : 0", "'0'"),
    ],
)
def test_bad_field_is_named(tmp_path: Path, old: str, new: str, words: str) -> None:
    path = tmp_path / "film.cih"
    assert old in CIH
    path.write_text(CIH.replace(old, new))
    with pytest.raises(FilmError) as caught:
        read_header(path)
    message = str(caught.value)
    assert words in message and str(path) in message and "\n" not in message
    assert caught.value.exit_code == 2


def test_entity_bomb_and_open_tag_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "film.cihx"
    path.write_bytes(b'<cih><!ENTITY a "b"><x>&a;</x></cih>')
    with pytest.raises(FilmError, match="declaration"):
        read_header(path)
    path.write_bytes(b"CIHX <cih><frameInfo>")
    with pytest.raises(FilmError, match="cut short"):
        read_header(path)
