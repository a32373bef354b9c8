"""What long work is doing at the moment, for whoever wants to show it; nobody need listen."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar

_LISTENER: ContextVar[Callable[[str], None] | None] = ContextVar("listener", default=None)
"""Who is told in this thread or task; nobody by default, so that nodes and notebooks hear nothing.
Each thread has its own, so that two diagnoses at a time do not mix."""


def tell(step: str) -> None:
    """Say what begins now.

    Args:
        step: a few words, such as "refitting with viscous_drag".
    """
    listener = _LISTENER.get()
    if listener is not None:
        listener(step)


@contextmanager
def told_to(listener: Callable[[str], None]) -> Iterator[None]:
    """Tell a listener each step of what is done inside.

    Args:
        listener: called with each step, at most some hundred times in a minute.
    """
    token = _LISTENER.set(listener)
    try:
        yield
    finally:
        _LISTENER.reset(token)
