"""From joint positions and fingertip force to contact point, normal and force in the world."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.contact.hand_kinematics import HandKinematics
from tactile_dynamics_ros.core.contact.joint_uncertainty import JointUncertaintyConfig
from tactile_dynamics_ros.core.contact.skin_surface import (
    point_from_wrench,
    point_under_force,
    skin_normal,
)
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.rigid_body.rotation import skew

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ContactStateConfig:
    """What the contact's place and frame are worth."""

    point_std: float = parameter(1e-3, "contact place on the skin", "m", 0.0, 0.02)
    mount_std_deg: float = parameter(0.5, "mounting of a tip on its finger", "deg", 0.0, 20.0)
    touch_force: float = parameter(0.03, "force below which nothing is touched", "N", 0.0, 5.0)
    joints: JointUncertaintyConfig = field(default_factory=JointUncertaintyConfig)

    def __post_init__(self) -> None:
        check_ranges(self)


@dataclass(frozen=True)
class Contact:
    """One finger's contact in the world.

    Attributes:
        finger: its name.
        point: (3,) m. rotation: (3, 3) R_WC, column z is the normal into the object.
        force: (3,) N that the finger applies on the object.
        force_std: (3,) N per world axis, including the uncertainty of the sensor's orientation.
        force_covariance: (3, 3) N^2. point_covariance: (3, 3) m^2.
        touching: whether the force exceeds the touch threshold.
    """

    finger: str
    point: Array
    rotation: Array
    force: Array
    force_std: Array
    force_covariance: Array
    point_covariance: Array
    touching: bool


class ContactState:
    """Place fingertip forces in the world.

    Args:
        kinematics: of arm and hand.
        config: uncertainties.
    """

    def __init__(
        self, kinematics: HandKinematics, config: ContactStateConfig | None = None
    ) -> None:
        self.kinematics = kinematics
        self.config = config or ContactStateConfig()
        joints = self.config.joints
        self._joint_variance = joints.varying_variance() + joints.constant_variance()

    def update(
        self,
        finger: str,
        joint_positions: Array,
        force: Array,
        force_std: Array,
        torque: Array | None = None,
    ) -> Contact:
        """Return the contact of a finger.

        f_W = R_WS f_S; cov = R diag(std^2) R^T + [f]x cov(rotation) [f]x^T.

        Args:
            finger: name.
            joint_positions: (23,) rad, arm then hand.
            force: (3,) on the object, sensor frame, N.
            force_std: (3,) N, sensor frame.
            torque: (3,) N m of that force about the sensor origin, which tells where on the skin
                the contact is; without it the contact is taken where the normal is along the force.

        Raises:
            BadInputError: a value is not finite.
        """
        force, force_std = _finite("force", force), _finite("force_std", force_std)
        pose = self.kinematics.sensor_pose(finger, joint_positions)
        place = point_under_force(force)
        if torque is not None and np.any(torque):
            place = point_from_wrench(force, _finite("torque", torque))
        rotation = pose[:3, :3]
        point = rotation @ place + pose[:3, 3]
        jacobian = self.kinematics.jacobian(finger, joint_positions, point)
        frame = (jacobian * self._joint_variance) @ jacobian.T
        frame[:3, :3] += np.deg2rad(self.config.mount_std_deg) ** 2 * np.eye(3)
        force_W = rotation @ force
        cross = skew(force_W)
        covariance = (rotation * force_std**2) @ rotation.T + cross @ frame[:3, :3] @ cross.T
        return Contact(
            finger=finger,
            point=point,
            rotation=rotation @ _contact_frame(place),
            force=force_W,
            force_std=np.sqrt(np.diag(covariance)),
            force_covariance=covariance,
            point_covariance=frame[3:, 3:] + self.config.point_std**2 * np.eye(3),
            touching=bool(np.linalg.norm(force) > self.config.touch_force),
        )


def _contact_frame(place: Array) -> Array:
    """Return R_SC of a skin point: z outward (into the object), x as far as possible along x."""
    normal = skin_normal(place)
    lengthwise = np.array([1.0, 0.0, 0.0]) if abs(normal[0]) < 0.9 else np.array([0.0, 0.0, 1.0])
    x = lengthwise - (lengthwise @ normal) * normal
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(normal, x), normal])


def _finite(name: str, value: Array) -> Array:
    value = np.asarray(value, dtype=float)
    if value.shape != (3,) or not np.all(np.isfinite(value)):
        raise BadInputError(f"{name} = {value.tolist()}: expected three finite numbers")
    return value
