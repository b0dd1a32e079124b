"""Ctrl-C waits until the bench is safe."""

from __future__ import annotations

import os
import signal
import threading

import pytest

from rig.safety.interrupts import defer_interrupts


@pytest.mark.usefixtures("keyboard")
@pytest.mark.skipif(os.name == "nt", reason="signal.raise_signal(SIGINT) ends the test run on Windows")
def test_an_interrupt_inside_the_block_arrives_after_it() -> None:
    steps = []
    with pytest.raises(KeyboardInterrupt):
        with defer_interrupts():
            signal.raise_signal(signal.SIGINT)
            steps.append("made safe")
        steps.append("not reached")
    assert steps == ["made safe"]
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_in_another_thread_the_block_simply_runs() -> None:
    ran = []

    def work() -> None:
        with defer_interrupts():
            ran.append(True)

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert ran == [True]
