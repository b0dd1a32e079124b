"""Backends are found by the scheme of their address."""

from __future__ import annotations

import pytest

from rig.backend import open_backend
from rig.errors import InputError


@pytest.mark.parametrize("url", ["", "sim", "tcp://x", "//", "unknown://local"])
def test_an_address_no_backend_answers_to_is_refused_and_the_installed_ones_named(url, config) -> None:
    with pytest.raises(InputError, match="no backend for it; installed are"):
        open_backend(url, config)
