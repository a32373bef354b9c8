"""Process that computes for a node: one child per job, so that memory and time end with it.

Jobs come on standard input and answers go to standard output, each a length and a pickle. A job is
a function of the core, by its name, and its arguments. Every job is computed in a fork of this
process, which has the core loaded and nothing else: no threads, no DDS. What a job allocated is
given back when it ends, and a job that dies is one answer, not the end of the node.
"""

from __future__ import annotations

import ctypes
import os
import pickle
import signal
import struct
import sys
import traceback
from collections.abc import Callable
from contextlib import suppress
from typing import Any, BinaryIO

from tactile_dynamics_ros.core.errors import TactileDynamicsError

NICENESS = 10
"""Steps of scheduling priority below the nodes: messages are taken first on a busy machine."""
LENGTH = struct.Struct("<Q")
PR_SET_PDEATHSIG = 1
"""Linux's prctl option: the signal that a process gets when its parent ends."""


def send(stream: BinaryIO, value: object) -> None:
    """Write a value."""
    data = pickle.dumps(value, protocol=pickle.HIGHEST_PROTOCOL)
    stream.write(LENGTH.pack(len(data)) + data)
    stream.flush()


def receive(stream: BinaryIO) -> Any:
    """Read a value.

    Raises:
        EOFError: the other side has ended.
    """
    return pickle.loads(_read(stream, LENGTH.unpack(_read(stream, LENGTH.size))[0]))


def _read(stream: BinaryIO, count: int) -> bytes:
    data = stream.read(count)
    if len(data) < count:
        raise EOFError("the other side has ended")
    return data


def main() -> int:
    """Answer jobs until standard input ends.

    The argument of the command line is the process that gives them.
    """
    _end_with_parent()
    if os.getppid() != int(sys.argv[1]):  # it ended before this one could ask to be told
        return 0
    with suppress(OSError):  # a sandbox may forbid it
        os.nice(NICENESS)
    jobs, answers = sys.stdin.buffer, os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what a library prints must not get among the answers
    import tactile_dynamics_ros.core.inertia.diagnosis.live_check
    import tactile_dynamics_ros.core.inertia.live.refit  # noqa: F401  (loaded once, for all forks)

    while True:
        try:
            function, arguments = receive(jobs)
        except EOFError:
            return 0
        child = os.fork()
        if child == 0:
            _end_with_parent()
            _answer(answers, function, arguments)
        if os.waitpid(child, 0)[1] != 0:
            send(answers, TactileDynamicsError("a computation was ended before it was done"))


def _answer(answers: BinaryIO, function: Callable[..., object], arguments: tuple[Any, ...]) -> None:
    """Compute, send the result or the error, and leave."""
    try:
        result = function(*arguments)
    except TactileDynamicsError as error:
        result = error
    except Exception as error:
        traceback.print_exc()
        result = TactileDynamicsError(f"a computation failed: {type(error).__name__}: {error}")
    try:
        send(answers, result)
    finally:
        os._exit(0)


def _end_with_parent() -> None:
    """Let this process be killed when its parent ends, however that ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)


if __name__ == "__main__":
    sys.exit(main())
