"""The one family of errors that the package raises on purpose."""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches
from importlib.util import find_spec
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


class MissingExtraError(BadInputError, ImportError):
    """A library that only one of the package's extras brings is not installed."""


def require_extra(library: str, extra: str, purpose: str) -> None:
    """Check that a library of an extra can be imported, without importing it.

    Args:
        library: name of its module.
        extra: of this package, that brings it.
        purpose: what needs it, for the message.

    Raises:
        MissingExtraError: it is not installed; says how to install it.
    """
    if find_spec(library) is None:
        raise MissingExtraError(
            f"{purpose} needs {library}, which is not installed: "
            f"pip install 'tactile_dynamics_ros[{extra}]' or pip install {library}"
        )


def refuse_existing(path: Path) -> None:
    """Check that a path to be written is new, so that nothing recorded is lost.

    Raises:
        BadInputError: it exists already.
    """
    if path.exists():
        raise BadInputError(f"{path} exists already; choose another path or remove it")


def nearest_file(path: str | Path) -> str:
    """Return the same of a path that is not there: names in its folder, or of its folder.

    Args:
        path: that is missing.
    """
    path = Path(path)
    parent = path.parent
    try:
        names = [entry.name for entry in parent.iterdir()]
    except OSError:
        return nearest_file(parent) if parent != path else ""
    found = get_close_matches(path.name, names, 1)
    return f"; did you mean '{parent / found[0]}'?" if found else ""


def nearest(name: str, known: Iterable[str]) -> str:
    """Return the end of a sentence that names what was probably meant; empty if nothing is near.

    Args:
        name: that is unknown.
        known: what it could have been.
    """
    found = get_close_matches(name, [*known], 1)
    return f"; did you mean '{found[0]}'?" if found else ""
