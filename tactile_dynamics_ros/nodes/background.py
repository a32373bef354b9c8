"""Heavy work beside the messages: one thread of low priority."""

from __future__ import annotations

import contextlib
import os
import threading
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

Result = TypeVar("Result")

NICENESS = 10


class Background:
    """Runs one function at a time; messages go on being taken meanwhile."""

    def __init__(self) -> None:
        self._pool = ThreadPoolExecutor(1, initializer=_lower_priority)
        self._pending = 0

    @property
    def busy(self) -> bool:
        """Whether something runs or waits."""
        return self._pending > 0

    def submit(self, work: Callable[[], Result]) -> Future[Result]:
        """Run a function as soon as the thread is free."""
        self._pending += 1
        future = self._pool.submit(work)
        future.add_done_callback(self._count_down)
        return future

    def close(self) -> None:
        """Drop what waits; do not wait for what runs."""
        self._pool.shutdown(wait=False, cancel_futures=True)

    def _count_down(self, _: Future[Result]) -> None:
        self._pending -= 1


def _lower_priority() -> None:
    with contextlib.suppress(OSError):
        os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), NICENESS)
