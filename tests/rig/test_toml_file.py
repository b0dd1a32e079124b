"""TOML written is TOML read back."""

from __future__ import annotations

import math
import tomllib

from hypothesis import given
from hypothesis import strategies as st

from rig.toml_file import dump_toml

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
