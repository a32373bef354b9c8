"""How a process ends on Ctrl-C (SIGINT) or SIGTERM: soon, with its files written, and with 0."""

from __future__ import annotations

import ctypes
import faulthandler
import math
import os
import signal
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from typing import NoReturn

TIME_TO_END = 2.5
"""Real time from the request until a process that still runs is ended, s: half a second before the
3 s that are promised. A node that waits needs 0.1 to 0.3 s where a dozen others compute on two
cores; one that fits needs 1.3 to 2.4 s where 15 to 20 do."""

REQUESTS = (signal.SIGINT, signal.SIGTERM)
"""Signals that ask a process to stop."""


class Stopped(BaseException):
    """Leaves what runs because the process was asked to stop; no `except Exception` catches it."""


class StopRequest:
    """Context in which the first SIGINT or SIGTERM sets `requested`; later ones do nothing.

    One within another raises `Stopped` as it is entered, where the outer one has raised it already:
    libraries that load catch it, and nothing is to begin any longer.

    Args:
        patience: real time from the request until `Stopped` is raised in the main thread, whatever
            runs there, s; 0: at once; infinite: never. May be changed before the request.
        limit: real time from the request until a process that hangs prints where and is ended with
            exit code 1, or with 0 after `work_done`, s; None: it is not ended.
        at_once: called when the request comes, wherever the main thread is.

    Attributes:
        requested: whether the process was asked to stop.
    """

    def __init__(
        self,
        patience: float = math.inf,
        limit: float | None = None,
        at_once: Callable[[], None] = lambda: None,
    ) -> None:
        self.requested = False
        self.patience, self._limit, self._at_once = patience, limit, at_once

    def __enter__(self) -> StopRequest:
        around = getattr(signal.getsignal(signal.SIGINT), "__self__", None)
        if isinstance(around, StopRequest) and around.requested and around.patience == 0.0:
            raise Stopped
        handlers = dict.fromkeys(REQUESTS, self._on_request)
        if self.patience < math.inf:
            handlers[signal.SIGALRM] = self._on_alarm
        self._before = {n: signal.signal(n, handler) for n, handler in handlers.items()}
        return self

    def __exit__(self, *_: object) -> None:
        if self.requested and self._limit is not None:
            faulthandler.cancel_dump_traceback_later()
        if signal.SIGALRM in self._before:
            signal.setitimer(signal.ITIMER_REAL, 0.0)
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def work_done(self) -> None:
        """Say that all files are written: what hangs from now on is left without a word."""
        if self.requested and self._limit is not None:
            leave_within(max(0.0, self._since + self._limit - time.monotonic()))
            faulthandler.cancel_dump_traceback_later()

    def _on_request(self, *_: object) -> None:
        if self.requested:
            return
        self.requested = True
        self._since = time.monotonic()
        if self._limit is not None:
            faulthandler.dump_traceback_later(self._limit, exit=True)
        self._at_once()
        if self.patience == 0.0:
            raise Stopped
        if self.patience < math.inf:
            signal.setitimer(signal.ITIMER_REAL, self.patience)

    def _on_alarm(self, *_: object) -> None:
        if self.patience < math.inf:
            raise Stopped


def hold_requests() -> None:
    """Let requests to stop wait until `take_requests`, also in a program that replaces this one.

    A supervisor calls it in the process that becomes a node: an interpreter that just starts would
    be killed by SIGTERM, and print a traceback for SIGINT.
    """
    signal.pthread_sigmask(signal.SIG_BLOCK, REQUESTS)


def take_requests() -> None:
    """Answer requests from now on, and one that waits at once."""
    signal.pthread_sigmask(signal.SIG_UNBLOCK, REQUESTS)


def leave(code: int) -> NoReturn:
    """End this process here, without taking its interpreter down.

    That takes longer than all the rest: 1.0 of 1.1 s from Ctrl-C to the end of a node while eight
    others compute on two cores. It unloads scipy and gtsam and joins threads, which may hang.
    Whoever calls this has written its files and left DDS.

    Args:
        code: exit code.
    """
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError):  # nobody reads any longer
            stream.flush()
    os._exit(code)


class _TimerEvent(ctypes.Structure):
    """`struct sigevent` of the C library, for an event that a thread of its own answers."""

    _fields_ = (
        ("value", ctypes.c_void_p),
        ("signal", ctypes.c_int),
        ("notify", ctypes.c_int),
        ("function", ctypes.c_void_p),
        ("attributes", ctypes.c_void_p),
        ("rest", ctypes.c_char * 32),
    )


class _TimerSetting(ctypes.Structure):
    """`struct itimerspec` of the C library: period and delay, s and ns."""

    _fields_ = tuple((name, ctypes.c_long) for name in ("period", "period_ns", "delay", "delay_ns"))


_SIGEV_THREAD = 2
"""Notification of `timer_create` that calls a function in a new thread (Linux' sigevent.h)."""


def leave_within(seconds: float) -> None:
    """End this process after a time with exit code 0, whatever its threads do until then.

    For a process that leaves DDS: deleting a participant did not return in 2 of 1,500 ends
    (fastrtps 2.14.5, 15 nodes that end together on two cores), with Python's lock held, so that
    neither a thread nor a signal handler of Python could end it. A POSIX timer that calls `_exit`
    of the C library can.

    Args:
        seconds: real time from now.
    """
    library = ctypes.CDLL(None)
    leave_now = ctypes.cast(library._exit, ctypes.c_void_p)
    event = _TimerEvent(value=0, notify=_SIGEV_THREAD, function=leave_now)
    timer = ctypes.c_void_p()
    if library.timer_create(time.CLOCK_MONOTONIC, ctypes.byref(event), ctypes.byref(timer)):
        return
    whole, part = divmod(max(1, round(seconds * 1e9)), 10**9)  # 0 would never come
    setting = _TimerSetting(delay=whole, delay_ns=part)
    library.timer_settime(timer, 0, ctypes.byref(setting), None)
