"""Live estimation of what a dexterous hand is holding.

The verbs of the command from Python: `read`, `read_wrist`, `check`, `estimate`, `compare`,
`diagnose`, `explain`, `shape` (`docs/python.md`), and the types of what they take and return. They
are imported when they are first asked for.
"""

from typing import TYPE_CHECKING, Any

from tactile_dynamics_ros.version import __version__

if TYPE_CHECKING:
    from tactile_dynamics_ros.api import (
        Check,
        Comparison,
        Diagnosis,
        Estimate,
        EstimateOfPushes,
        Explanation,
        PushedCheck,
        PushedRecording,
        Recording,
        Shape,
        check,
        compare,
        diagnose,
        estimate,
        explain,
        read,
        read_wrist,
        shape,
    )


__all__ = [
    "Check",
    "Comparison",
    "Diagnosis",
    "Estimate",
    "EstimateOfPushes",
    "Explanation",
    "PushedCheck",
    "PushedRecording",
    "Recording",
    "Shape",
    "__version__",
    "check",
    "compare",
    "diagnose",
    "estimate",
    "explain",
    "read",
    "read_wrist",
    "shape",
]


def __getattr__(name: str) -> Any:
    """Return a verb of the Python interface.

    Raises:
        AttributeError: there is none of this name.
    """
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import import_module

    return getattr(import_module(f"{__name__}.api"), name)


def __dir__() -> list[str]:
    """Return what there is, for completion in notebooks."""
    return [*__all__]
