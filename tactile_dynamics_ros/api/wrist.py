"""A wrist sensor beside the fingertips: what it measures of the object that they hold."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tactile_dynamics_ros.core.discrepancy.verdict.wording import write_interval

if TYPE_CHECKING:
    from tactile_dynamics_ros.core.inertia.batch.inertial_estimate import InertialEstimate
    from tactile_dynamics_ros.core.rigid_body.inertial_parameters import KnownBody
    from tactile_dynamics_ros.recording import Recording


def read_wrist(
    path: str | Path, robot: str | None = None, namespace: str | None = None
) -> Recording:
    """Read what the wrist sensor carries, hand and object, as one held object.

    Args:
        path: bag with `/wrist/wrench` and `/joint_states`.
        robot: file in config/robots, or path of a yaml file; the default robot if None.
        namespace: of the topics; root if None.

    Raises:
        BadInputError: it cannot be read, or it is of another robot.
    """
    from tactile_dynamics_ros.recording.wrist import read_wrist as read

    return read(path, robot, namespace)


@dataclass(frozen=True)
class WristShare:
    """What the wrist measures of a held object, the hand taken out.

    Attributes:
        recording: of the fingertips.
        wrist: of all that the wrist carries, from the same bag.
        hand: that is carried as well, in the frame of the flange; its file names the effects that
            the wrist sensor has.
    """

    recording: Recording
    wrist: Recording
    hand: KnownBody

    @cached_property
    def body(self) -> InertialEstimate:
        """The object in its own frame.

        Raises:
            BadInputError: the hand is not the one that was carried, or nothing was held meanwhile.
        """
        from tactile_dynamics_ros.core.effects import create_effect
        from tactile_dynamics_ros.core.inertia.batch.knowledge import without_tool
        from tactile_dynamics_ros.core.inertia.batch.wrist import grip, seen_from
        from tactile_dynamics_ros.core.inertia.estimate import estimate
        from tactile_dynamics_ros.recording.wrist import while_held

        streams, flange, held = while_held(self.wrist, self.recording)
        effects = [create_effect(name) for name in self.hand.effects]
        load = without_tool(estimate(streams, effects).to_estimate(), self.hand, True)
        return seen_from(load, *grip(flange, held))

    @property
    def known(self) -> KnownBody:
        """The object as something known beside the fingertips."""
        from tactile_dynamics_ros.core.inertia.batch.wrist import told_apart
        from tactile_dynamics_ros.core.rigid_body.inertial_parameters import KnownBody

        body = self.body
        return KnownBody(
            body.inertia.dynamic_parameters, told_apart(body), "the wrist", body.not_excited
        )

    @cached_property
    def gains(self) -> dict[str, tuple[float, float]]:
        """How much too large each fingertip reports its force, with std; empty without a mass."""
        from tactile_dynamics_ros.core.effects import create_effect
        from tactile_dynamics_ros.core.inertia.batch.wrist import fingertip_gains
        from tactile_dynamics_ros.core.inertia.estimate import estimate

        names = list(self.recording.streams.contacts)
        if len(names) < 2 or "mass" in self.body.not_excited:
            return {}
        fitted = estimate(self.recording, [create_effect("force_scale:" + "+".join(names))])
        return fingertip_gains(fitted, self.body.inertia.mass, float(self.body.parameter_std[0]))

    def line(self) -> str:
        """Say what the wrist measures by itself, and by how much each fingertip differs."""
        mass = write_interval(self.body.inertia.mass, float(self.body.parameter_std[0]))
        shares = ", ".join(
            f"{name} {write_interval(100.0 * gain, 100.0 * std)} %"
            for name, (gain, std) in self.gains.items()
        )
        gains = f"; against it the fingertips read too much by {shares}" if shares else ""
        return f"the wrist by itself, without {self.hand.name}: {mass} kg{gains}"

    def to_json(self) -> dict[str, Any]:
        """Return its part of the document of `estimate`."""
        body = self.body
        return {
            "hand": self.hand.name,
            "mass": {"value": body.inertia.mass, "std": float(body.parameter_std[0])},
            "undetermined": list(body.not_excited),
            "gains": {
                name: {"value": gain, "std": std, "unit": ""}
                for name, (gain, std) in self.gains.items()
            },
        }
