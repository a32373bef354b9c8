"""Levels and depths of the diagnosis."""

from __future__ import annotations

from dataclasses import dataclass

from tactile_dynamics_ros.core.configuration import check_ranges, parameter


@dataclass(frozen=True)
class DiagnosisConfig:
    """Levels and depths of the diagnosis."""

    significance: float = parameter(0.01, "family-wise level of the adequacy test", "", 1e-9, 0.5)
    depth: int = parameter(3, "effects tried together before giving up", "", 1, 6)
    explained: float = parameter(
        0.95, "share of the excess error that counts as explained in any case", "", 0.5, 1.0
    )
    near_floor: float = parameter(
        1.12, "white RMS over its floor that counts as explained in any case", "", 1.0, 2.0
    )
    dominating: float = parameter(
        0.99,
        "share of the excess error by which one effect is the cause of most of it",
        "",
        0.9,
        1.0,
    )
    complete: float = parameter(
        0.995,
        "share of the excess error by which several effects are its cause, whatever is left",
        "",
        0.9,
        1.0,
    )
    beyond_stated: float = parameter(
        0.8,
        "share of the excess error that must go where lasting errors of the sensors remain",
        "",
        0.0,
        1.0,
    )
    beside_stated: float = parameter(
        0.6, "the same where the error is within what the sensors state", "", 0.0, 1.0
    )
    vibration: float = parameter(
        0.5,
        "share of the excess error in one line of the spectrum that makes a vibration",
        "",
        0.1,
        1.0,
    )
    first_progress: float = parameter(
        0.25, "share of the excess error that one effect must explain to go on", "", 0.0, 1.0
    )
    second_progress: float = parameter(
        0.8, "share that two effects must explain to be reconsidered together", "", 0.0, 1.0
    )
    third_progress: float = parameter(
        0.95, "share that reconsidered effects must explain for one more to be tried", "", 0.0, 1.0
    )
    indifference: float = parameter(
        10.0, "difference of -2 log evidence that does not decide", "", 0.0, 100.0
    )

    def __post_init__(self) -> None:
        """Check ranges."""
        check_ranges(self)
