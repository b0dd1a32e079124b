"""Backends are found by the scheme of their address, and must have every member of the contract."""

from __future__ import annotations

import time
from importlib.metadata import EntryPoint

import pytest

import rig.backend
from rig import Backend, Capabilities, InputError, RigInputError, load_profile, open_backend, record, resume
from rig.backend import check_contract
from rig.selftest import SelftestBackend


@pytest.mark.parametrize("url", ["", "sim", "tcp://x", "//", "unknown://local"])
def test_an_address_no_backend_answers_to_is_refused_and_the_installed_ones_named(url, config) -> None:
    with pytest.raises(InputError, match="no backend for it; installed are"):
        open_backend(url, config)


class Bare:
    """What the contract asked for before it declared waiting, positions and resuming."""

    capabilities = Capabilities("bare", simulated=True, description={})

    def configure(self, config, command_v): ...

    def arm(self, *, enable_drive=True): ...

    def start(self): ...

    def read_block(self, n_samples, timeout_s): ...

    def safe_stop(self): ...

    def close(self): ...


class Derived(Bare, Backend):
    """The same with the defaults."""


def test_a_backend_that_lacks_a_member_is_refused_before_anything_is_made(config, monkeypatch, tmp_path) -> None:
    lacking = "backend Bare: lacks continue_after, read_positions, wait; derive it from rig.backend.Backend"
    with pytest.raises(RigInputError, match=lacking):
        record(tmp_path / "s", profile=load_profile("forte"), backend=Bare())
    with pytest.raises(RigInputError, match=lacking):
        resume(tmp_path / "s", Bare())
    assert not (tmp_path / "s").exists()
    entry = EntryPoint("bare", f"{__name__}:unused", rig.backend.GROUP)
    monkeypatch.setattr(EntryPoint, "load", lambda self: lambda url, config: Bare())
    monkeypatch.setattr(rig.backend, "entry_points", lambda group: (entry,))
    with pytest.raises(RigInputError, match=lacking):
        open_backend("bare://", config)


def test_a_backend_that_derives_from_the_contract_has_the_documented_defaults() -> None:
    backend = Derived()
    check_contract(backend)
    assert backend.read_positions() == {}
    backend.continue_after(3)
    began_s = time.monotonic()
    backend.wait(0.02)
    assert time.monotonic() - began_s >= 0.02


def test_both_backends_of_the_rig_have_what_a_recording_and_a_self_test_call(config, make_backend) -> None:
    backend = make_backend(config)
    check_contract(backend)
    check_contract(backend, SelftestBackend)
    assert Backend in type(backend).__mro__
