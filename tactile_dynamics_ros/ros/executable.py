"""A node as a process: its start and stop.

A node loads its libraries for seconds. This module loads none, so that a request to stop that comes
meanwhile is answered: `executable.explorer` is the function that runs nodes/explorer.py.
"""

from __future__ import annotations

import importlib
import math
import sys
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import NoReturn

from tactile_dynamics_ros.stopping import TIME_TO_END, Stopped, StopRequest, leave, take_requests


def start(name: str) -> NoReturn:
    """Run a node with the arguments of this process, and end the process with its exit code.

    Args:
        name: of the executable.
    """
    code = 0
    with StopRequest(patience=0.0, limit=TIME_TO_END) as stop, suppress(Stopped):
        take_requests()
        try:
            node = importlib.import_module(f"tactile_dynamics_ros.nodes.{name}")
        except Exception:
            if not stop.requested:
                raise
        if not stop.requested:  # libraries catch what leaves them while they load, or fail by it
            code = node.main()
        stop.patience = math.inf
    leave(code)


def __getattr__(name: str) -> Callable[[], NoReturn]:
    """Return the function that runs a node.

    Raises:
        AttributeError: there is no such node.
    """
    if not (Path(__file__).parents[1] / "nodes" / f"{name}.py").is_file():
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return partial(start, name)


if __name__ == "__main__":
    sys.argv = sys.argv[1:]
    start(sys.argv[0])
