"""Heavy work beside the messages, in a process of low priority."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from threading import Lock
from typing import Any, TypeVar
from weakref import WeakSet

from tactile_dynamics_ros.core.errors import TactileDynamicsError
from tactile_dynamics_ros.ros.worker import receive, send

Result = TypeVar("Result")

WORKER = [sys.executable, "-P", "-m", "tactile_dynamics_ros.ros.worker"]

_OPEN: WeakSet[Background] = WeakSet()
"""All of this process."""


def abandon_all() -> None:
    """End what runs in the background of this process, which is about to end.

    First of all: what is killed gives back its memory at its low priority, for seconds on a busy
    machine, while files are written.
    """
    for one in _OPEN:
        one.abandon()


class Background:
    """Computes one function at a time; messages go on being taken meanwhile.

    The functions belong to modules of the core; they and their arguments and results are pickled.

    Attributes:
        closed: whether nothing is computed any longer, and nobody is interested in results.
    """

    def __init__(self) -> None:
        self._pool = ThreadPoolExecutor(1)
        self._pending = 0
        self._starting = Lock()
        self.closed = False
        self._start()
        _OPEN.add(self)

    @property
    def busy(self) -> bool:
        """Whether something runs or waits."""
        return self._pending > 0

    def submit(self, work: Callable[..., Result], *arguments: Any) -> Future[Result]:
        """Compute as soon as the process is free."""
        self._pending += 1
        future = self._pool.submit(self._compute, work, arguments)
        future.add_done_callback(self._count_down)
        return future

    def drop(self) -> None:
        """End what runs, whose result nobody wants any longer, so that the next need not wait."""
        if self.busy:
            self._kill()

    def close(self) -> None:
        """Drop what waits, and end what runs; do not wait until it has ended.

        That may take seconds on a busy machine: what was killed needs processor time to end.
        """
        with self._starting:
            self.abandon()
        self._pool.shutdown(wait=False, cancel_futures=True)

    def abandon(self) -> None:
        """End what runs, and compute nothing any longer."""
        self.closed = True
        self._kill()

    def _kill(self) -> None:
        with suppress(ProcessLookupError):
            os.killpg(self._process.pid, signal.SIGKILL)

    def _start(self) -> None:
        """Start the process in a group of its own: Ctrl-C of a terminal is the node's affair."""
        self._process = subprocess.Popen(
            [*WORKER, str(os.getpid())],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            start_new_session=True,
        )

    def _start_again(self) -> None:
        """Replace a process that ended, unless nothing is wanted any longer."""
        self._process.wait()
        with self._starting:
            if not self.closed:
                self._start()

    def _compute(self, work: Callable[..., Result], arguments: tuple[Any, ...]) -> Result:
        assert self._process.stdin is not None and self._process.stdout is not None
        try:
            send(self._process.stdin, (work, arguments))
            answer = receive(self._process.stdout)
        except (EOFError, OSError) as error:
            if not self.closed:
                self._start_again()
            raise TactileDynamicsError("the process that computes for this node ended") from error
        if isinstance(answer, TactileDynamicsError):
            raise answer
        result: Result = answer
        return result

    def _count_down(self, _: Future[Result]) -> None:
        self._pending -= 1
