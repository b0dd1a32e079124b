"""Work for each of several items: in the order of the items, with the first item's error, by threads or in turn."""

from __future__ import annotations

import threading

import pytest

from vision.tracking.workers import workers


@pytest.mark.parametrize("threads", [1, 3])
def test_each_keeps_the_order_and_raises_the_first_error(threads: int) -> None:
    seen: set[str] = set()
    first_waits = threading.Event()

    def work(item: int) -> int:
        seen.add(threading.current_thread().name)
        if threads > 1 and item == 0:
            assert first_waits.wait(20.0)  # until a later item is done
        first_waits.set()
        if item in (4, 6):
            raise ValueError(f"item {item}")
        return 10 * item

    with workers(threads) as crew:
        assert crew.each(work, range(4)) == [0, 10, 20, 30]
        with pytest.raises(ValueError, match="item 4"):
            crew.each(work, range(3, 8))
    assert (len(seen) > 1) == (threads > 1)
