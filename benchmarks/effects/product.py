"""The one place that touches the product: its command, asked as a user's script would ask it."""

from __future__ import annotations

import contextlib
import io
import json
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Answer:
    """What the command printed as JSON, its exit code, its complaint and how long it took."""

    code: int
    json: dict[str, Any] | None
    complaint: str
    seconds: float


Ask = Callable[[Sequence[str]], Answer]


def ask_command(arguments: Sequence[str]) -> Answer:
    """Run `tactile-dynamics ARGUMENTS --json` in this process."""
    from tactile_dynamics_ros.cli.main import main

    printed, complained = io.StringIO(), io.StringIO()
    begin = time.perf_counter()
    with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(complained):
        code = main([*arguments, "--json"])
    seconds = time.perf_counter() - begin
    text = printed.getvalue().strip()
    answer = json.loads(text) if text else None
    return Answer(code, answer, complained.getvalue().strip()[-1000:], seconds)
