"""The door to estimates of arms by their joint torques: `estimate(recording, effects)`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.joints.arm import Arm
from tactile_dynamics_ros.core.joints.model import JointsModel
from tactile_dynamics_ros.core.joints.payload import Payload
from tactile_dynamics_ros.core.joints.samples import JointSamples
from tactile_dynamics_ros.core.streams.joint_streams import JointStreams

Array = NDArray[np.float64]

_MOVED = 0.05
"""Range of a joint's positions below which it has not moved, rad or m: friction and bodies are then
one constant."""
_FREE_SHARE = 0.4
"""How far a URDF's bodies may be off beside a recording without the payload, which tells them
better: as far as any URDF is, so that whatever the model misses in both goes to the links and not
to the payload."""


@dataclass(frozen=True, eq=False)
class JointsEstimate:
    """Friction of each joint, the payload, effects, and what is undetermined.

    Attributes:
        model: fitted.
        streams: the recording, with the payload if there are two.
        compared: whether a recording without the payload stood beside it.
    """

    model: JointsModel
    streams: JointStreams
    compared: bool = False

    @cached_property
    def payload(self) -> Payload:
        """What the flange carries beyond what the URDF says."""
        return Payload.of(self.model)

    @cached_property
    def error(self) -> float:
        """Error over the noise, 1 where only noise remains."""
        return float(np.sqrt(np.mean(self.model.residual**2)))

    @property
    def still(self) -> tuple[str, ...]:
        """Joints that hardly moved."""
        samples = self.model.samples
        reach = np.ptp(samples.q.reshape(-1, samples.q.shape[2]), axis=0)
        pairs = zip(samples.arm.names, reach, strict=True)
        return tuple(name for name, one in pairs if one < _MOVED)

    @property
    def undetermined(self) -> tuple[str, ...]:
        """Names of what the recording does not tell."""
        own = [f"{name}.{kind}" for name in self.still for kind in ("coulomb", "viscous", "offset")]
        return (*(f"payload.{name}" for name in self.payload.undetermined), *own)

    @cached_property
    def table(self) -> dict[str, dict[str, dict[str, Any]]]:
        """Parameters of joints and effects by name."""
        return self.model.parameters()

    def to_document(self) -> dict[str, Any]:
        """The document of `estimate`."""
        arm, table = self.model.samples.arm, self.table
        errors = self.model.residuals().physical
        return {
            "model": "joints",
            "samples": len(self.streams.time),
            "duration_s": self.streams.duration,
            "payload": self.payload.to_document(),
            "compared_without_load": self.compared,
            "joints": [
                {
                    "name": name,
                    **table[name],
                    "noise": float(noise),
                    "error": float(np.sqrt(np.mean(errors[:, k] ** 2))),
                }
                for k, (name, noise) in enumerate(
                    zip(arm.names, self.model.effort_std, strict=True)
                )
            ],
            "urdf_off_by": self.model.basis.share,
            "undetermined": list(self.undetermined),
            "effects": {effect.name: table[effect.name] for effect in self.model.effects},
            "error": self.error,
        }


def fit(
    streams: JointStreams,
    effects: Sequence[str] = (),
    without: JointStreams | None = None,
    flange: str = "",
) -> JointsModel:
    """Fit the model of an arm to a recording.

    Args:
        streams: with the payload, if any.
        effects: names, with readings.
        without: the same arm without the payload; the same motion cancels what the model misses.
        flange: link whose frame the payload is told in; found by its name if empty.

    Raises:
        BadInputError: there is no URDF, it is of another arm, or an effect is unknown.
        NotIdentifiableError: a recording is too short.
    """
    if not streams.urdf:
        raise BadInputError("joints: no URDF of the arm; give it by --urdf FILE")
    arm = Arm.from_urdf(streams.urdf, streams.names, "the arm's URDF", flange)
    samples = JointSamples.from_streams(streams, arm)
    if without is None:
        return JointsModel.fit(samples, effects)
    empty = JointSamples.from_streams(without, arm)
    empty = replace(empty, loaded=np.zeros(len(empty.time), dtype=bool))
    return JointsModel.fit(JointSamples.join([empty, samples]), effects, _FREE_SHARE)


def estimate(
    streams: JointStreams,
    effects: Sequence[str] = (),
    without: JointStreams | None = None,
    flange: str = "",
) -> JointsEstimate:
    """Estimate friction, payload and effects of an arm; arguments as of `fit`."""
    return JointsEstimate(fit(streams, effects, without, flange), streams, without is not None)
