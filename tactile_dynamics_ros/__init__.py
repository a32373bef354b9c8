"""Live estimation of what a dexterous hand is holding.

The verbs of the command from Python: `read`, `read_wrist`, `check`, `estimate`, `compare`,
`diagnose`, `explain`, `shape` (`docs/python.md`), and the types of what they take and return. They
are imported when they are first asked for. Matrices here are small: BLAS takes one thread, unless
the environment says otherwise or numpy is already loaded.
"""

import os
from typing import TYPE_CHECKING, Any

from tactile_dynamics_ros.version import __version__

if TYPE_CHECKING:
    from tactile_dynamics_ros.api.checks import Check
    from tactile_dynamics_ros.api.discrepancies import Comparison, Diagnosis, Explanation
    from tactile_dynamics_ros.api.estimates import Estimate
    from tactile_dynamics_ros.api.joint_checks import JointCheck
    from tactile_dynamics_ros.api.joint_estimates import EstimateOfJoints
    from tactile_dynamics_ros.api.pushed_checks import PushedCheck
    from tactile_dynamics_ros.api.pushed_estimates import EstimateOfPushes
    from tactile_dynamics_ros.api.reading import read
    from tactile_dynamics_ros.api.shapes import Shape
    from tactile_dynamics_ros.api.verbs import (
        check,
        compare,
        diagnose,
        estimate,
        explain,
        shape,
    )
    from tactile_dynamics_ros.api.wrist import read_wrist
    from tactile_dynamics_ros.recording import Recording
    from tactile_dynamics_ros.recording.joints import JointRecording
    from tactile_dynamics_ros.recording.pushed import PushedRecording

for _threads in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_threads, "1")

_MODULES = {
    "Check": "api.checks",
    "Comparison": "api.discrepancies",
    "Diagnosis": "api.discrepancies",
    "Estimate": "api.estimates",
    "EstimateOfJoints": "api.joint_estimates",
    "EstimateOfPushes": "api.pushed_estimates",
    "Explanation": "api.discrepancies",
    "JointCheck": "api.joint_checks",
    "JointRecording": "recording.joints",
    "PushedCheck": "api.pushed_checks",
    "PushedRecording": "recording.pushed",
    "Recording": "recording",
    "Shape": "api.shapes",
    "read": "api.reading",
    "read_wrist": "api.wrist",
}
"""Where what is not a verb comes from: imported on demand, as each costs a second."""

__all__ = [
    "Check",
    "Comparison",
    "Diagnosis",
    "Estimate",
    "EstimateOfJoints",
    "EstimateOfPushes",
    "Explanation",
    "JointCheck",
    "JointRecording",
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
    """Return a verb, or the type of what a verb takes or returns.

    Raises:
        AttributeError: there is none of this name.
    """
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import import_module

    module = _MODULES.get(name, "api.verbs")
    return getattr(import_module(f"{__name__}.{module}"), name)


def __dir__() -> list[str]:
    """Return what there is, for completion in notebooks."""
    return [*__all__]
