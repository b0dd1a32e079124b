"""TOML written is TOML read back; what does not fit is told in one line."""

from __future__ import annotations

import math
import tomllib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rig.configuration.rig_file import RigConfig
from rig.configuration.toml_file import check, dump_toml
from rig.errors import InputError
from rig.session.info import RoomInfo

scalars = st.one_of(
    st.booleans(),
    st.integers(-(2**63), 2**63 - 1),
    st.floats(allow_nan=False),
    st.text(st.characters(exclude_categories=("Cs",))),
)
keys = st.text(st.characters(exclude_categories=("Cs",)), max_size=8)
values = st.recursive(
    scalars,
    lambda inner: st.one_of(st.lists(inner, max_size=4), st.dictionaries(keys, inner, max_size=4)),
    max_leaves=12,
)


@given(st.dictionaries(keys, values, max_size=5))
def test_any_table_survives_a_round_trip(table) -> None:
    assert tomllib.loads(dump_toml(table)) == table


def test_none_is_left_out_and_nan_kept() -> None:
    read = tomllib.loads(dump_toml({"a": None, "b": math.nan}))
    assert set(read) == {"b"} and math.isnan(read["b"])


@pytest.mark.parametrize("value", [float("nan"), "warm", -300.0, 61.0, True])
def test_a_value_of_several_kinds_is_told_in_one_line_with_all_of_them(value: object) -> None:
    with pytest.raises(InputError) as caught:
        check(RoomInfo, {"temperature_c": value}, "a.toml")
    said = str(caught.value)
    assert said.startswith(f"a.toml: temperature_c = {value!r}: input should be")
    assert said.endswith(" or input should be 'unknown'")
    assert check(RoomInfo, {"temperature_c": "unknown"}, "a.toml").temperature_c == "unknown"


def test_a_misspelt_key_is_named_before_the_one_it_leaves_missing() -> None:
    with pytest.raises(InputError, match=r"unknown key devic = 1; .* device is missing"):
        check(RigConfig, {"devic": 1}, "a.toml")
