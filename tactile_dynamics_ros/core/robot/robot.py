"""A robot as data: arm, hand or gripper, fingertips, and what controllers must know of them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import BadInputError

LEAST_HOLDING = 3
"""Fingers that hold an object where there are so many (of fewer, all): three points of contact
resist every wrench, two only if they carry torque. Fewer would let it turn about a line; more would
leave a hand of four no finger that probes."""


@dataclass(frozen=True)
class Following:
    """How a joint follows another one (`mimic` in a URDF): q = factor q_leader + offset.

    Attributes:
        leader: name of the other joint.
        factor: rad or m of this joint per rad or m of the other.
        offset: rad or m.
    """

    leader: str
    factor: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True, eq=False)
class Joint:
    """A joint of the kinematic tree.

    Attributes:
        name, parent, child: names of the joint and of the two links (frames).
        origin: (4, 4) pose of the child in the parent at zero.
        axis: (3,) unit vector in the child frame, or None if the joint is fixed.
        slides: whether it shifts along the axis; if not, it turns about it.
        lower, upper: limits, rad (m if it slides).
        effort: largest torque, N m (N). velocity: limit, rad/s (m/s).
        kp: N m/rad (N/m) and kd: N m s/rad (N s/m) of the joint's drive.
        follows: what it follows; None if it moves by itself.
    """

    name: str
    parent: str
    child: str
    origin: Array
    axis: Array | None = None
    slides: bool = False
    lower: float = 0.0
    upper: float = 0.0
    effort: float = 0.0
    velocity: float = 0.0
    kp: float = 0.0
    kd: float = 0.0
    follows: Following | None = None


@dataclass(frozen=True, eq=False)
class Finger:
    """One finger of a hand, or one jaw of a gripper.

    Attributes:
        name: part of topics.
        sensor: link whose frame its sensor reports in. touches: link whose surface touches.
        joints: its own joints from the palm to the tip.
        seed: (K,) joint positions from which a grasp is sought, rad or m.
        side: face of an object on which it presses: -1 or 1.
        lateral: its place along the row of fingers, in units of a grasp site's spread.
        stagger: how much deeper it presses than others of its side, in units of a site's stagger.
        pad: (3,) direction into the object that suits the sensor best, sensor frame.
    """

    name: str
    sensor: str
    touches: str
    joints: tuple[Joint, ...]
    seed: Array
    side: int
    lateral: float
    stagger: float
    pad: Array


@dataclass(frozen=True, eq=False)
class Fingertips:
    """What all fingertips of a robot are.

    Attributes:
        kind: "biotac" (raw counts, a round skin) or "pad" (force and torque of a flat face);
            part of topics.
        radius: radius of a round skin about the sensor frame's origin, m; 0 for a flat face,
            in which the origin lies.
    """

    kind: str
    radius: float

    @property
    def carries_torque(self) -> bool:
        """Whether a contact transmits torque that the sensor measures."""
        return self.kind == "pad"


@dataclass(frozen=True, eq=False)
class GraspHabit:
    """How the palm stands about what it takes (`core.manipulation.grasp_site`).

    Attributes:
        palm_rotation: (3, 3) R_GP of the palm in the grasp frame: x from the face of side -1 to
            that of side 1, z the approach.
        depth: depth of the grasp centre beyond the palm along the approach, m, unless the object
            says otherwise.
        thumb: place of the fingertip of side 1 behind the palm's origin along x, m, unless the
            object says otherwise; None for a gripper, which closes about its middle and whose
            depth no object changes.
        pivot: (3,) point of the palm frame about which held objects are turned, m.
    """

    palm_rotation: Array
    depth: float
    thumb: float | None
    pivot: Array


@dataclass(frozen=True, eq=False)
class Robot:
    """Arm and hand: kinematic tree, fingers, drives. `load_robot` makes one.

    Attributes:
        name: of the robot and of its file.
        urdf: text of its URDF. folder: where its relative files lie, or "".
        tree: all joints, each after the one that carries its parent.
        base: link that stands in the world. flange: link of the wrist's sensor. palm: where
            fingers start.
        arm: joints that move the palm, base first.
        hand: fingers, in the order of topics, images and joints.
        reference: finger that opposes the others, so that every grasp has it.
        tips: kind of all fingertips.
        home: (A,) arm joints from which a grasp is sought, rad.
        carry: (A,) arm joints in which a held object is moved about, rad.
        arm_radius: radius of spheres along the arm that hide it from cameras, m.
        arm_resolution, hand_resolution: steps of the encoders, rad (m if a joint slides).
        grasp: how the palm stands about an object.
    """

    name: str
    urdf: str
    folder: str
    tree: tuple[Joint, ...]
    base: str
    flange: str
    palm: str
    arm: tuple[Joint, ...]
    hand: tuple[Finger, ...]
    reference: str
    tips: Fingertips
    home: Array
    carry: Array
    arm_radius: float
    arm_resolution: float
    hand_resolution: float
    grasp: GraspHabit

    @cached_property
    def fingers(self) -> tuple[str, ...]:
        """Names of the fingers in their order."""
        return tuple(finger.name for finger in self.hand)

    @cached_property
    def _rows(self) -> Mapping[str, int]:
        return {name: row for row, name in enumerate(self.fingers)}

    @cached_property
    def hand_joints(self) -> tuple[Joint, ...]:
        """Joints of all fingers, finger by finger."""
        return tuple(joint for finger in self.hand for joint in finger.joints)

    @cached_property
    def joints(self) -> tuple[Joint, ...]:
        """Joints that move, arm first: the order of all vectors of joints."""
        return self.arm + self.hand_joints

    @cached_property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the joints that move."""
        return tuple(joint.name for joint in self.joints)

    @cached_property
    def followers(self) -> Mapping[str, Following]:
        """What joints follow, by the names of those that do."""
        return {joint.name: joint.follows for joint in self.joints if joint.follows is not None}

    @property
    def arm_dof(self) -> int:
        """Number A of the arm's joints."""
        return len(self.arm)

    @property
    def dof(self) -> int:
        """Number J of joints that move."""
        return len(self.joints)

    @cached_property
    def owned(self) -> Mapping[str, slice]:
        """Where each finger's joints are in a vector (J,) of all joints."""
        found, start = {}, self.arm_dof
        for finger in self.hand:
            found[finger.name] = slice(start, start + len(finger.joints))
            start += len(finger.joints)
        return found

    @cached_property
    def hand_seed(self) -> Array:
        """Joint positions (H,) of the hand from which fingertips are sought."""
        return np.concatenate([finger.seed for finger in self.hand])

    @cached_property
    def start(self) -> Array:
        """Joint positions (J,) with the arm at home and the hand half closed."""
        return np.concatenate([self.home, self.hand_seed])

    @cached_property
    def sides(self) -> Array:
        """Face on which each finger presses (F,): -1 or 1, the reference finger's."""
        return np.array([finger.side for finger in self.hand])

    @property
    def least_holding(self) -> int:
        """Number of fingers that must press on what is held."""
        return min(LEAST_HOLDING, len(self.hand))

    def finger_index(self, finger: str) -> int:
        """Return the row of a finger.

        Raises:
            BadInputError: there is no such finger.
        """
        row = self._rows.get(finger)
        if row is None:
            known = ", ".join(self.fingers)
            raise BadInputError(f"finger '{finger}': expected one of {known} ({self.name})")
        return row

    def sensor_frame(self, finger: str) -> str:
        """Return the name of a finger's sensor frame (a link)."""
        return self.hand[self.finger_index(finger)].sensor

    def require_tips(self, kind: str, user: str) -> None:
        """Check that fingertips are of a kind.

        Raises:
            BadInputError: they are of another; names who needs them.
        """
        if self.tips.kind != kind:
            raise BadInputError(
                f"{user}: robot '{self.name}' has fingertips of kind '{self.tips.kind}', "
                f"expected '{kind}'; leave {user} out"
            )


def column(joints: Iterable[Joint], name: str) -> Array:
    """Return one number of each joint (J,): `column(robot.joints, "upper")`."""
    return np.array([getattr(joint, name) for joint in joints], dtype=float)
