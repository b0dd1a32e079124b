"""A session of one trial and its report."""

from __future__ import annotations

import pytest

from rig.session import Session
from validation import validate_session

HOSTILE = "<script>alert('x')</script>&\"quote\""


@pytest.fixture(scope="session")
def lonely(make, shared):
    """One trial, no film, hostile text in the session; reported into its own folder."""

    def reported(folder):
        session, truth = make.session(folder / "s", n_trials=1, filmed=(), operator=HOSTILE, name=HOSTILE)
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr("validation.verdict.error_draws.DRAWS", 99)  # as many as an interval needs
            return session.path, validate_session(session, truth.action, rivals=(), explain=False)

    path, result = shared(reported)
    return Session.open(path), result
