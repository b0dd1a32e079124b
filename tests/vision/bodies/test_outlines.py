"""Outlines: the file preserves them, bad ones are refused by name, masks contain only the body's own pixels."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vision import Body, BodyError, build_masks, load_bodies, save_bodies
from vision.bodies.outlines import sort_parents_first
from vision.synthetic import box

names = st.text(st.characters(exclude_categories=["Cs"]), min_size=1, max_size=12)
coordinate = st.floats(-5000.0, 5000.0, allow_nan=False)


@given(
    st.lists(names, min_size=1, max_size=4, unique=True),
    st.lists(st.tuples(coordinate, coordinate), min_size=3, max_size=3),
    st.integers(-9, 9),
)
def test_toml_round_trip(
    tmp_path_factory: pytest.TempPathFactory,
    body_names: list[str],
    extra: list[tuple[float, float]],
    layer: int,
) -> None:
    path = tmp_path_factory.mktemp("bodies") / "b.toml"
    outline = np.vstack([box(0.125, -3.5, 101.0, 77.25), np.array(extra) + 1e4])
    bodies = [Body(name, outline + i, body_names[i - 1] if i else None, layer) for i, name in enumerate(body_names)]
    save_bodies(path, bodies)
    found = load_bodies(path)
    for a, b in zip(bodies, found, strict=True):
        assert (a.name, a.parent, a.layer) == (b.name, b.parent, b.layer)
        np.testing.assert_array_equal(a.polygon_px, b.polygon_px)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "holds no"),
        ("[[body]]\nname = 'a'\n", "polygon_px"),
        ("[[body]]\nname = 'a'\npolygon_px = [[0,0],[1,1]]\n", "m >= 3"),
        ("[[body]]\nname = 'a'\npolygon_px = [[0,0],[9,0],[nan,9]]\n", "NaN"),
        ("[[body]]\nname = 'a'\npolygon_px = [[0,0],[9,0],['x',9]]\n", "pairs"),
        ("[[body]]\nname = 'a'\npolygon_px = [[0,0],[9,9],[18,18]]\n", "encloses"),
        ("[[body]]\nname = 'a'\ncolour = 1\npolygon_px = [[0,0],[9,0],[9,9]]\n", "colour"),
        ("[[body]]\nname = 'a'\nparent = 'b'\npolygon_px = [[0,0],[9,0],[9,9]]\n", "'b'"),
        ("[[body]]\nname = 'a'\nlayer = 1.5\npolygon_px = [[0,0],[9,0],[9,9]]\n", "1.5"),
        ("body = 3", "holds no"),
        ("[[body", "TOML"),
    ],
)
def test_bad_file_is_one_clear_line(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "b.toml"
    path.write_text(text)
    with pytest.raises(BodyError) as caught:
        load_bodies(path)
    assert words in str(caught.value) and str(path) in str(caught.value) and "\n" not in str(caught.value)
    assert caught.value.exit_code == 2


def test_parents(tmp_path: Path) -> None:
    square = box(0, 0, 30, 20)
    chain = [Body("c", square, "b"), Body("b", square, "a"), Body("a", square)]
    assert sort_parents_first(chain) == [2, 1, 0]
    with pytest.raises(BodyError, match="circle"):
        sort_parents_first([Body("a", square, "b"), Body("b", square, "a")])
    with pytest.raises(BodyError, match="unique"):
        sort_parents_first([Body("a", square), Body("a", square)])
    with pytest.raises(BodyError, match="cannot be read"):
        load_bodies(tmp_path / "absent.toml")
    with pytest.raises(BodyError, match="cannot be written"):
        save_bodies(tmp_path / "absent" / "b.toml", chain)


def test_masks_leave_out_the_rim_and_what_is_in_front() -> None:
    back, front = box(10, 10, 80, 40), box(50, 5, 70, 60)
    masks = build_masks([Body("back", back, layer=0), Body("front", front, layer=1)], 64, 96)
    rows, cols = np.nonzero(masks[0])
    assert rows.min() == 15 and rows.max() == 35 and cols.min() == 15  # 4 px of rim, the line itself excluded
    assert not masks[0][:, 46:75].any() and masks[0][20, 45] and masks[0][20, 75]
    assert masks[1][20:40, 55:65].all()
    # of one layer, each gives way to the other
    same = build_masks([Body("back", back), Body("front", front)], 64, 96)
    assert not same[1][10:41, 55:65].any() and same[1][50, 60]


def test_too_small_or_outside_is_refused() -> None:
    with pytest.raises(BodyError, match="tiny: .* usable pixels"):
        build_masks([Body("tiny", box(0, 0, 12, 12))], 64, 96)
    with pytest.raises(BodyError, match="away: 0 usable"):
        build_masks([Body("away", box(200, 0, 300, 90))], 64, 96)
