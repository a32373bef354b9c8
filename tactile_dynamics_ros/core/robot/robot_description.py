"""The robot as plain data: KUKA LBR iiwa 14 with a right Allegro hand v4 and four BioTac tips.

One table for kinematics, the simulator's URDF and the controllers. Frames follow URDF: a joint's
origin is the pose of the child frame in the parent frame at zero, rpy is fixed-axis roll-pitch-yaw.
In the palm frame z points to the finger tips, x out of the palm on the grasping side and y towards
the index finger. In a sensor frame x points to the tip and -z out of the pad.

Source: simlabrobotics/allegro_hand_ros_v4 (hand geometry, masses, driver gains, PWM caps),
LL4MA description (BioTac mounts), pybullet_data kuka_iiwa (arm), KUKA data sheet (arm limits).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Vector3 = tuple[float, float, float]

FINGERS = ("index", "middle", "ring", "thumb")
"""Names of the fingers in the order of the hand's bus; part of topics and joint order."""
BASE_LINK = "lbr_iiwa_link_0"
"""Link that stands in the world."""
FLANGE_LINK = "wrist_ft"
"""Link of the wrist's force/torque sensor, at the arm's flange."""
PALM_LINK = "palm_link"
"""Link of the palm; fingers start here."""
HAND_ENCODER_RESOLUTION = np.deg2rad(333.3) / 65536
"""Step of the hand's encoders, rad: 333.3 deg over 16 bits. Source: Allegro driver."""
SKIN_RADIUS = 0.007
"""Radius of the idealised skin of a BioTac, m. Source: skin-projected electrodes of TAMS. It is
added to every contact point: a millimetre more moves all of them out by one."""
CORE_RADIUS = 0.0054
"""Radius of a BioTac's rigid core, m (5.1 to 5.4 mm by its electrodes), that the simulator collides
with where the skin is pressed through."""
CORE_LENGTH = 0.014
"""Length of the core's cylinder behind the tip's centre, m: to the last electrodes (x = -13.6
mm)."""
PI = np.pi
"""A half turn, rad."""
HALF_PI = 0.5 * PI
"""A right angle, rad."""


@dataclass(frozen=True)
class Joint:
    """A joint of the robot; ``axis`` None means fixed.

    Attributes:
        name, parent, child: names of the joint and of the two links (frames).
        xyz: (3,) m, rpy: (3,) rad, pose of the child in the parent at zero.
        axis: unit vector in the child frame, or None.
        lower, upper: rad.
        effort: torque cap, N m. velocity: limit, rad/s.
        kp: N m/rad and kd: N m s/rad of the joint drive.
    """

    name: str
    parent: str
    child: str
    xyz: Vector3
    rpy: Vector3 = (0.0, 0.0, 0.0)
    axis: Vector3 | None = None
    lower: float = 0.0
    upper: float = 0.0
    effort: float = 0.0
    velocity: float = 0.0
    kp: float = 0.0
    kd: float = 0.0

    def origin(self) -> Array:
        """Pose of the child frame in the parent frame at zero, (4, 4)."""
        transform = np.eye(4)
        transform[:3, :3] = rpy_to_matrix(self.rpy)
        transform[:3, 3] = self.xyz
        return transform


@dataclass(frozen=True)
class Link:
    """Mass and shape of a link, all in the link frame.

    Attributes:
        name: name of the link (frame).
        mass: kg. com: (3,) m. inertia: (3,) principal moments about the CoM, link axes, kg m^2.
        boxes: pairs of full size (3,) and centre (3,), m.
    """

    name: str
    mass: float
    com: Vector3
    inertia: Vector3
    boxes: tuple[tuple[Vector3, Vector3], ...] = ()


def rpy_to_matrix(rpy: Vector3 | Array) -> Array:
    """R = R_z(yaw) R_y(pitch) R_x(roll) of fixed-axis angles (3,) in rad."""
    (sr, sp, sy), (cr, cp, cy) = np.sin(rpy), np.cos(rpy)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def described_pose(values: Mapping[str, Any]) -> Array:
    """Pose (4, 4) of a description: ``centre`` in m and ``rpy_deg``, each zero where absent."""
    pose = np.eye(4)
    pose[:3, 3] = np.asarray(values.get("centre", (0.0, 0.0, 0.0)), dtype=float)
    angles = np.asarray(values.get("rpy_deg", (0.0, 0.0, 0.0)), dtype=float)
    pose[:3, :3] = rpy_to_matrix(np.deg2rad(angles))
    return pose


_ARM_JOINTS: tuple[tuple[Vector3, Vector3, float, float, float], ...] = (
    ((0, 0, 0.1575), (0, 0, 0), 2.967, 320, 85),
    ((0, 0, 0.2025), (HALF_PI, 0, PI), 2.094, 320, 85),
    ((0, 0.2045, 0), (HALF_PI, 0, PI), 2.967, 176, 100),
    ((0, 0, 0.2155), (HALF_PI, 0, 0), 2.094, 176, 75),
    ((0, 0.1845, 0), (-HALF_PI, PI, 0), 2.967, 110, 130),
    ((0, 0, 0.2155), (HALF_PI, 0, 0), 2.094, 40, 135),
    ((0, 0.081, 0), (-HALF_PI, PI, 0), 3.054, 40, 135),
)
"""Each joint of the arm: xyz (m), rpy (rad), limit (rad), torque cap (N m), speed limit (deg/s).
Source: pybullet_data kuka_iiwa (frames); LBR iiwa 14 R820 (limits and speeds of its description,
torques as remembered, hardware facts 3.2)."""

_ARM_LINKS: tuple[tuple[float, Vector3, Vector3], ...] = (
    (5.0, (-0.1, 0, 0.07), (0.05, 0.06, 0.03)),
    (4.0, (0, -0.03, 0.12), (0.1, 0.09, 0.02)),
    (4.0, (0.0003, 0.059, 0.042), (0.05, 0.018, 0.044)),
    (3.0, (0, 0.03, 0.13), (0.08, 0.075, 0.01)),
    (2.7, (0, 0.067, 0.034), (0.03, 0.01, 0.029)),
    (1.7, (0.0001, 0.021, 0.076), (0.02, 0.018, 0.005)),
    (1.8, (0, 0.0006, 0.0004), (0.005, 0.0036, 0.0047)),
    (0.3, (0, 0, 0.02), (0.001, 0.001, 0.001)),
)
"""Each link of the arm, base first: mass (kg), centre of mass (m), principal moments (kg m^2).
Source: pybullet_data kuka_iiwa. Drives follow positions, so that they hardly matter."""

_FINGER_ROOTS: dict[str, tuple[Vector3, Vector3]] = {
    "index": ((0, 0.0435, -0.001542), (-0.08726646, 0, 0)),
    "middle": ((0, 0, 0.0007), (0, 0, 0)),
    "ring": ((0, -0.0435, -0.001542), (0.08726646, 0, 0)),
    "thumb": ((-0.0182, 0.019333, -0.045987), (0, -1.65806278845, -1.5707963259)),
}
"""Where each finger starts in the palm's frame: xyz (m), rpy (rad). Source, of these and the rows
below: allegro_hand_ros_v4, right hand."""
_FINGER_OFFSETS: tuple[Vector3, ...] = ((0, 0, 0.0164), (0, 0, 0.0540), (0, 0, 0.0384))
"""From joint to joint of a finger, m."""
_THUMB_OFFSETS: tuple[Vector3, ...] = ((-0.0270, 0.0050, 0.0399), (0, 0, 0.0177), (0, 0, 0.0514))
"""From joint to joint of the thumb, m."""
_FINGER_AXES: tuple[Vector3, ...] = ((0, 0, 1), (0, 1, 0), (0, 1, 0), (0, 1, 0))
"""Axes of a finger's joints: abduction about z, then flexion about y."""
_THUMB_AXES: tuple[Vector3, ...] = ((-1, 0, 0), (0, 0, 1), (0, 1, 0), (0, 1, 0))
"""Axes of the thumb's joints."""
_FINGER_LIMITS = ((-0.470, 0.470), (-0.196, 1.610), (-0.174, 1.709), (-0.227, 1.618))
"""Lower and upper limits of a finger's joints, rad."""
_THUMB_LIMITS = ((0.263, 1.396), (-0.105, 1.163), (-0.189, 1.644), (-0.162, 1.719))
"""Lower and upper limits of the thumb's joints, rad."""
_FINGER_EFFORT = (0.3125, 0.5625, 0.3750, 0.2375)
"""Torque caps of a finger's joints, N m: the driver's PWM caps (375, 675, 450, 285) over its 1200
PWM per N m. They bound the grip to about 4 N per fingertip."""
_THUMB_EFFORT = (0.4375, 0.3375, 0.225, 0.225)
"""Torque caps of the thumb's joints, N m: 525, 405, 270, 270 PWM."""
_FINGER_KD = (0.125, 0.167, 0.125, 0.125)
"""Damping of a finger's drives, N m s/rad: 150 to 200 PWM units over 1200, the driver's stiff
gains."""
_THUMB_KD = (0.25, 0.167, 0.167, 0.125)
"""Damping of the thumb's drives, N m s/rad."""
_HAND_KP = 3.33
"""Stiffness of all drives of the hand, N m/rad: 4000 PWM units over 1200, the driver's stiff gains.
A grip is commanded as an offset of torque over stiffness; with softer drives
`squeeze.stiffness_scale` must follow."""
_HAND_VELOCITY = 6.283
"""Speed limit of the hand's joints, rad/s. Source: Isaac kuka_allegro.urdf (the 7 rad/s of the
hand's own URDF is a placeholder)."""

_FINGER_MASSES = (0.0119, 0.0650, 0.0355, 0.0096)
"""Masses of a finger's links, kg, from the palm to the tip."""
_THUMB_MASSES = (0.0176, 0.0119, 0.0380, 0.0388)
"""Masses of the thumb's links, kg."""
_BIOTAC_MASS = 0.021
"""Mass of a BioTac, kg. Source: LL4MA description."""
_FINGER_BOXES: tuple[tuple[Vector3, Vector3], ...] = (
    ((0.0196, 0.0275, 0.0164), (0, 0, 0.0082)),
    ((0.0196, 0.0275, 0.0540), (0, 0, 0.0270)),
    ((0.0196, 0.0275, 0.0384), (0, 0, 0.0192)),
    ((0.0196, 0.0275, 0.0267), (0, 0, 0.01335)),
)
"""Size and centre of the box that each link of a finger collides as, m; inertias follow from them,
since those of the URDF are placeholders. The tracker takes them out of images."""
_THUMB_BOXES: tuple[tuple[Vector3, Vector3], ...] = (
    ((0.0358, 0.0340, 0.0455), (-0.0179, 0.009, 0.0145)),
    ((0.0196, 0.0275, 0.0177), (0, 0, 0.00885)),
    ((0.0196, 0.0275, 0.0514), (0, 0, 0.0257)),
    ((0.0196, 0.0275, 0.0423), (0, 0, 0.02115)),
)
"""Size and centre of the boxes of the thumb's links, m."""
_PALM_BOX: tuple[Vector3, Vector3] = ((0.0408, 0.1130, 0.0950), (-0.0093, 0, -0.0475))
"""Size and centre of the palm's box, m."""
_BIOTAC_RPY = (0.0, -1.22129, 0.0)
"""Turn from a distal link to its sensor frame, rad: x 20 deg towards the palm. Source: LL4MA
description."""


def joint_index(finger: str, k: int) -> int:
    """Number 0..15 of joint k (0 proximal .. 3 distal) of a finger, in bus order."""
    return 4 * FINGERS.index(finger) + k


def sensor_frame(finger: str) -> str:
    """Name of the BioTac frame (a link) of a finger."""
    return f"biotac_{finger}"


def _box_inertia(mass: float, size: Vector3) -> Vector3:
    x, y, z = size
    return (mass * (y * y + z * z) / 12, mass * (x * x + z * z) / 12, mass * (x * x + y * y) / 12)


def _arm_joints() -> Iterator[Joint]:
    for k, (xyz, rpy, limit, effort, speed) in enumerate(_ARM_JOINTS, start=1):
        yield Joint(
            f"lbr_iiwa_joint_{k}",
            f"lbr_iiwa_link_{k - 1}",
            f"lbr_iiwa_link_{k}",
            xyz,
            rpy,
            (0.0, 0.0, 1.0),
            -limit,
            limit,
            float(effort),
            float(np.deg2rad(speed)),
        )


def _finger_joints(finger: str) -> Iterator[Joint]:
    thumb = finger == "thumb"
    root, root_rpy = _FINGER_ROOTS[finger]
    offsets = (root, *(_THUMB_OFFSETS if thumb else _FINGER_OFFSETS))
    axes = _THUMB_AXES if thumb else _FINGER_AXES
    limits = _THUMB_LIMITS if thumb else _FINGER_LIMITS
    for k in range(4):
        n = joint_index(finger, k)
        yield Joint(
            f"joint_{n}.0",
            PALM_LINK if k == 0 else f"link_{n - 1}.0",
            f"link_{n}.0",
            offsets[k],
            root_rpy if k == 0 else (0.0, 0.0, 0.0),
            axes[k],
            *limits[k],
            effort=(_THUMB_EFFORT if thumb else _FINGER_EFFORT)[k],
            velocity=_HAND_VELOCITY,
            kp=_HAND_KP,
            kd=(_THUMB_KD if thumb else _FINGER_KD)[k],
        )


def _biotac_joint(finger: str) -> Joint:
    height = 0.0705 if finger == "thumb" else 0.0555
    distal = f"link_{joint_index(finger, 3)}.0"
    xyz = (0.0085, 0.00155, height)
    return Joint(f"biotac_{finger}_mount", distal, sensor_frame(finger), xyz, _BIOTAC_RPY)


def _arm_links() -> Iterator[Link]:
    for k, (mass, com, inertia) in enumerate(_ARM_LINKS):
        yield Link(f"lbr_iiwa_link_{k}", mass, com, inertia)


def _finger_links(finger: str) -> Iterator[Link]:
    thumb = finger == "thumb"
    boxes = _THUMB_BOXES if thumb else _FINGER_BOXES
    masses = _THUMB_MASSES if thumb else _FINGER_MASSES
    for k in range(4):
        size, centre = boxes[k]
        inertia = _box_inertia(masses[k], size)
        yield Link(f"link_{joint_index(finger, k)}.0", masses[k], centre, inertia, (boxes[k],))
    tip = _box_inertia(_BIOTAC_MASS, (0.028, 0.014, 0.014))
    yield Link(sensor_frame(finger), _BIOTAC_MASS, (-0.007, 0.0, 0.0), tip)


MOUNT_JOINTS = (
    Joint("wrist_ft_mount", "lbr_iiwa_link_7", FLANGE_LINK, (0.0, 0.0, 0.045)),
    Joint("palm_mount", FLANGE_LINK, PALM_LINK, (-0.03, 0.0, 0.08), (0.0, -7 * PI / 18, 0.0)),
)
"""Fixed joints between arm and palm. A bracket holds the palm 20 deg off the plane of the flange,
so that thumb and fingers oppose each other across the flange's axis; the flange is 45 mm from joint
7's frame."""
MOUNT_LINKS = (
    Link(FLANGE_LINK, 0.1, (0.0, 0.0, 0.0), (1e-4, 1e-4, 1e-4)),
    Link(PALM_LINK, 0.4154, _PALM_BOX[1], _box_inertia(0.4154, _PALM_BOX[0]), (_PALM_BOX,)),
)
"""Links between arm and hand: the wrist's sensor (0.1 kg, our guess) and the palm (0.4154 kg,
Source: allegro_hand_ros_v4)."""
ARM_JOINTS = tuple(_arm_joints())
"""Joints of the arm, base first."""
HAND_JOINTS = tuple(joint for finger in FINGERS for joint in _finger_joints(finger))
"""Joints of the hand in bus order: index, middle, ring, thumb; from the palm to the tip."""
BIOTAC_JOINTS = tuple(_biotac_joint(finger) for finger in FINGERS)
"""Fixed joints from distal links to sensor frames."""
ACTUATED_JOINTS = ARM_JOINTS + HAND_JOINTS
"""Joints that move, in the order of all vectors of joints."""
JOINTS = ARM_JOINTS + MOUNT_JOINTS + HAND_JOINTS + BIOTAC_JOINTS
"""All joints, each after the one that carries its parent."""
LINKS = (
    *_arm_links(),
    *MOUNT_LINKS,
    *(link for finger in FINGERS for link in _finger_links(finger)),
)
"""All links."""
ARM_JOINT_NAMES = tuple(joint.name for joint in ARM_JOINTS)
"""Names of the arm's joints as on /joint_states."""
HAND_JOINT_NAMES = tuple(joint.name for joint in HAND_JOINTS)
"""Names of the hand's joints as on /joint_states; those of the SimLab driver."""
JOINT_NAMES = ARM_JOINT_NAMES + HAND_JOINT_NAMES
"""Names of all joints that move."""
