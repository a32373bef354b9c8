"""Is a recording of joint torques fit for an estimate, and what should move more?"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from tactile_dynamics_ros.api.joint_estimates import EstimateOfJoints
from tactile_dynamics_ros.api.readiness import GOAL, Readiness, lost_faults
from tactile_dynamics_ros.api.result import Rows
from tactile_dynamics_ros.recording.rates import StreamRate

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from tactile_dynamics_ros.recording.joints import JointRecording

_SLOW_HZ = 40.0
"""Rate below which a recording is refused by `check`: blocks of four samples then last over 0.1 s,
and reversals of friction blur."""


@dataclass(frozen=True, repr=False)
class JointCheck(Readiness):
    """What a recording of an arm tells, and what is wrong with it.

    Attributes:
        asked: estimate from the recording as it is.
    """

    asked: EstimateOfJoints

    @property
    def source(self) -> str:
        """Where the recording came from."""
        return self.asked.recording.source

    @property
    def duration(self) -> float:
        """Length of the recording, s."""
        return self.asked.recording.duration

    @property
    def relative(self) -> dict[str, float]:
        """Standard deviation over size: of the payload's mass, and of each joint's friction."""
        found = self.asked.found
        mass = found.payload.to_document()["mass"]
        shares = {"payload mass": mass["std"] / max(abs(mass["value"]), 1e-9)}
        for joint in found.model.joints:
            entry, noise = found.table[joint]["coulomb"], found.model.effort_std
            size = max(abs(entry["value"]), float(noise[found.model.joints.index(joint)]))
            shares[f"friction of {joint}"] = entry["std"] / size
        return shares

    @property
    def lacking(self) -> list[str]:
        """Parameters that are not known as well as wanted."""
        return [name for name, share in self.relative.items() if not share <= self.goal]

    def to_json(self) -> dict[str, Any]:
        """Return the document of `check`."""
        return super().to_json() | {
            "error": self.asked.found.error,
            "undetermined": list(self.asked.undetermined),
            "parameters": {name: {"relative": share} for name, share in self.relative.items()},
        }

    def describe(self, name: str) -> str:
        """Return a parameter in words, as it is named."""
        return name

    def advice(self) -> list[str]:
        """Return what is not known, and what would tell it."""
        said = [f"{name} is known to {100.0 * self.relative[name]:.2g} %" for name in self.lacking]
        if "payload mass" in self.lacking and not self.asked.found.compared:
            said.append(
                "record the same motion without the payload and give it by --without, or hold the "
                "payload far from the base while the shoulder and the elbow move"
            )
        still = self.asked.found.still
        return said + ([f"move {', '.join(still)}: hardly moved so far"] if still else [])

    def rows(self) -> Rows:
        """Return how well each parameter is known."""
        body = [(name, f"{share:.1%}") for name, share in self.relative.items()]
        return [("parameter", "std over size"), *body]

    def draw(self) -> Figure:
        """Draw what is known now, and what is wanted."""
        from matplotlib.figure import Figure as NewFigure

        figure = NewFigure(layout="constrained")
        axes = figure.add_subplot()
        axes.barh(list(self.relative), [100.0 * s for s in self.relative.values()])
        axes.axvline(100.0 * self.goal, label="wanted", color="black", linestyle="--")
        axes.set_xlabel("standard deviation over size, %")
        axes.legend()
        return figure


def check_joints(recording: JointRecording, goal: float = GOAL) -> JointCheck:
    """Check a recording of joint torques; see `JointCheck`.

    Raises:
        BadInputError: the URDF is of another arm.
        NotIdentifiableError: the recording is too short.
    """
    asked = EstimateOfJoints.of(recording)
    rates = (StreamRate.of("joint states", recording.streams.time),)
    faults, remarks = lost_faults(rates), recording.problem_lines()
    if rates[0].rate_hz < _SLOW_HZ:
        faults.append(f"{rates[0].rate_hz:.0f} Hz: record joint states at 100 Hz or more")
    if not np.any(recording.streams.effort):
        faults.append("all efforts are zero: the driver reports no torques")
    if asked.question.misfit:
        (faults if asked.question.is_far else remarks).append(asked.question.misfit)
    return JointCheck(rates, tuple(faults), tuple(remarks), goal, asked)
