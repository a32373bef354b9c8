"""The one family of errors that the package raises on purpose."""

from __future__ import annotations

from pathlib import Path


class TactileDynamicsError(Exception):
    """Base of all deliberate errors; the message says what, where and what to do."""

    exit_code = 1


class BadInputError(TactileDynamicsError):
    """The input (file, topic, argument, configuration) cannot be used as it is."""

    exit_code = 2


class NotIdentifiableError(TactileDynamicsError):
    """The estimation did not converge or the data do not determine the answer."""

    exit_code = 3


def refuse_existing(path: Path) -> None:
    """Check that a path to be written is new, so that nothing recorded is lost.

    Raises:
        BadInputError: it exists already.
    """
    if path.exists():
        raise BadInputError(f"{path} exists already; choose another path or remove it")
